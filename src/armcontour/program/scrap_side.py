"""The scrap side of contours, inside of holes and outside of outer contours, and leads in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour._describing import several
from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.geometry.cutting import reverse_path
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.program._crossings import LENGTH, crossings
from armcontour.program.leads import WASTE, lead_path
from armcontour.program.moves import Contour, contour_called
from armcontour.program.nesting import chords_of, nest
from armcontour.program.process import Lead, Process

# Share of a lead beside the contour that it touches, along which contact is not judged.
CONTACT = 0.01
# Halvings in the search for the longest lead that fits: a share of 0.0001 of what does not.
HALVINGS = 14


def cut_contours(contours: Sequence[Contour], process: Process) -> BoolArray:
    """Contours at which material is separated: those with a kerf; all if no layer has a kerf."""
    found = np.array([process.of_layer(x.layer).kerf is not None for x in contours])
    return found if found.any() else ~found


def waste_sides(contours: Sequence[Contour], process: Process) -> list[str]:
    """The scrap side of every contour in its direction of travel, "left" or "right".

    Closed contours inside an odd number of other contours that are cut are holes, whatever their
    layers. The scrap side of open contours is "left".

    Args:
        contours: The contours in their direction of travel.
        process: Kerfs of the layers, and the direction from which the contours are viewed.
    """
    found = nest(contours, process.up)
    depths = found.holds[cut_contours(contours, process)].sum(axis=0)
    left = ((depths % 2 == 1) == (found.areas > 0)) | (found.areas == 0)
    return ["left" if x else "right" for x in left.tolist()]


class LeadPlacement:
    """Leads of the contours of a program, in the scrap and clear of all contours that are cut.

    Args:
        contours: The contours before they get overlaps and leads.
        process: The process.
    """

    def __init__(self, contours: Sequence[Contour], process: Process) -> None:
        self._contours, self._process = contours, process
        needed = any(x.side == WASTE for x in process.leads)
        self._sides = waste_sides(contours, process) if needed else ["left"] * len(contours)
        self._cut = cut_contours(contours, process)
        self._around: tuple[FloatArray, FloatArray] | None = None
        # Leads that are shorter than asked: share of the length, and a description.
        self._shortened: list[tuple[float, str]] = []

    def lay(self, number: int, path: Path, lead: Lead, length: float, *, after: bool) -> Path:
        """The lead-in or the lead-out of contour `number`.

        Args:
            number: The contour.
            path: Its path, with overlap.
            lead: Shape and side.
            length: Length of the lead [m]; one of automatic length is shortened to what fits.
            after: True for the lead-out.

        Raises:
            InvalidInput: An arc in the scrap crosses a contour that is cut, or begins in the part.
        """
        contour = self._contours[number]
        side = self._sides[number] if lead.side == WASTE else lead.side
        beyond = self._beyond(contour, path, after)

        def lead_of(length: float) -> Path:
            return lead_path(
                path, length, lead.shape, side, self._process.up, after=after, beyond=beyond
            )

        found = lead_of(length)
        judged = lead.shape == "arc" and lead.side == WASTE and contour.closed and self._cut[number]
        if not judged or self._process.of_layer(contour.layer).weave is not None:
            return found
        if self._fits(found, after):
            return found
        fits, too_long = 0.0, length
        for _ in range(HALVINGS):
            middle = (fits + too_long) / 2
            in_scrap = self._fits(lead_of(middle), after)
            fits, too_long = (middle, too_long) if in_scrap else (fits, middle)
        called, kind = contour_called(contour, number), "lead-out" if after else "lead-in"
        where = f"{called} (layer {contour.layer})" if contour.layer else called
        if not fits:
            raise InvalidInput(
                f"{where}: no {kind} in the shape of an arc lies in the scrap where the contour "
                f"{'ends' if after else 'begins'}: choose another start point (process.begin).",
                needed=length,
                allowed=0.0,
            )
        if lead.length is not None:
            raise InvalidInput(
                f"{where}: a {kind} of {1e3 * length:.4g} mm crosses a contour or leaves the "
                f"scrap; the longest that fits is {1e3 * fits:.4g} mm.",
                needed=length,
                allowed=fits,
            )
        said = f"the {kind} of {where}: {1e3 * fits:.4g} in place of {1e3 * length:.4g} mm"
        self._shortened.append((fits / length, said))
        return lead_of(fits)

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence on leads that are shorter than the tool needs to reach its speed, if any."""
        if not self._shortened:
            return ()
        count = several(len(self._shortened), "lead")
        return (
            "Leads are shorter than the tool needs to reach its speed, because longer ones cross a "
            f"contour or leave the scrap: {count}, most {min(self._shortened)[1]}.",
        )

    def _beyond(self, contour: Contour, path: Path, after: bool) -> FloatArray | None:
        """Unit tangent of a closed contour at the other side of the vertex that a lead touches."""
        own = contour.path
        # A contour with an overlap does not end at its start.
        if np.linalg.norm(own.end - own.starts[0]) > REPEATED_POINT:
            return None
        nearest = own.project(path(path.length if after else 0.0)[None])
        if nearest.distance[0] > 2 * REPEATED_POINT:
            return None
        s = float(own.breaks[np.argmin(np.abs(own.breaks - nearest.s[0]))])
        if abs(s - nearest.s[0]) > 2 * REPEATED_POINT:
            return None
        if after:
            return own(0.0 if s == own.length else s, 1)
        return own(s or own.length, 1, side="left")

    def _fits(self, lead: Path, after: bool) -> bool:
        """Whether a lead crosses no contour that is cut, and its free end lies in the scrap."""
        lead, up = reverse_path(lead) if after else lead, self._process.up
        cut = [x for x, kept in zip(self._contours, self._cut, strict=True) if kept]
        if self._around is None:
            tables = [_pieces(x.path, up) for x in cut]
            self._around = np.concatenate(tables), np.array([_box(x) for x in tables])
        pieces, boxes = self._around
        own = _pieces(lead, up)
        tip = own[0, :2]
        # No part of a piece or of the lead is farther from its start than its length.
        apart = np.linalg.norm(pieces[:, :2] - tip, axis=1)
        near = pieces[apart <= pieces[:, LENGTH] + lead.length + REPEATED_POINT]
        which, places = crossings(np.concatenate([own, near]))
        first = np.argmin(which, axis=1)[:, None]
        meets = (which.min(axis=1) < len(own)) & (which.max(axis=1) >= len(own))
        begins = np.cumsum(own[:, LENGTH]) - own[:, LENGTH]
        at = np.take_along_axis(places, first, 1)[meets, 0] + begins[which.min(axis=1)[meets]]
        if (at < (1 - CONTACT) * lead.length).any():
            return False
        held = np.nonzero(((boxes[:, 0] <= tip) & (tip <= boxes[:, 1])).all(axis=1))[0]
        holds = nest([*(cut[i] for i in held), Contour(path=lead)], up).holds
        return bool(holds[:, -1].sum() % 2 == 0)


def _box(pieces: FloatArray) -> FloatArray:
    """Corners of a box around pieces, (2, 2)."""
    starts, lengths = pieces[:, :2], pieces[:, LENGTH:]
    return np.stack([(starts - lengths).min(axis=0), (starts + lengths).max(axis=0)])


def _pieces(path: Path, up: FloatArray) -> FloatArray:
    """The table of pieces of `_crossings` of a path seen from above, (n, 6)."""
    chords = chords_of(path, up)
    a, chord, bent = chords[:, :2], chords[:, 2:4] - chords[:, :2], chords[:, 7] != 0
    curvatures = np.where(bent, chords[:, 7] / np.where(bent, chords[:, 6], 1.0), 0.0)
    out = (a - chords[:, 4:6]) * curvatures[:, None]
    lengths = np.linalg.norm(chord, axis=1)
    tangents = np.column_stack([-out[:, 1], out[:, 0]])
    tangents = np.where(bent[:, None], tangents, chord / lengths[:, None])
    half = np.arcsin(np.minimum(lengths * np.abs(curvatures) / 2, 1.0))
    return np.column_stack([a, tangents, curvatures, lengths / np.sinc(half / np.pi)])
