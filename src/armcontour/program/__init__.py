"""Programs: contours in order, with rapids, dwells and events between them."""

from typing import TYPE_CHECKING

from armcontour._lazy import lazy_names

if TYPE_CHECKING:
    from armcontour.program.kerf import cut_parts
    from armcontour.program.moves import Contour, Dwell, Event, Move, Program, Rapid, contour_called
    from armcontour.program.preparing import arrange, prepare
    from armcontour.program.process import (
        Analog,
        LayerProcess,
        Lead,
        Leads,
        Pierce,
        Process,
        Switch,
        Tabs,
        Weave,
    )
    from armcontour.program.rounding import (
        draw_with_arcs,
        put_on_path,
        round_corners,
        smooth_curvature,
    )
else:
    __getattr__, __all__ = lazy_names(
        __name__,
        {
            "kerf": "cut_parts",
            "moves": "Contour Dwell Event Move Program Rapid contour_called",
            "preparing": "arrange prepare",
            "process": "Analog LayerProcess Lead Leads Pierce Process Switch Tabs Weave",
            "rounding": "draw_with_arcs put_on_path round_corners smooth_curvature",
        },
    )
