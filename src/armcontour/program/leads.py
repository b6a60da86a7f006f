"""Leads: paths before and after a contour on which the tool accelerates and decelerates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import exp
from armcontour.core.text import count_noun
from armcontour.geometry import Path
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.prescribed_orientation import tangent_rates
from armcontour.geometry.segments import REPEATED_POINT, Segments
from armcontour.program.kerf import cut_contours, waste_sides
from armcontour.program.moves import Contour, contour_called
from armcontour.program.nesting import find_chords, find_nesting
from armcontour.program.offset_curves import LENGTH, THIN, find_crossings
from armcontour.program.process import WASTE, Lead, Process

# Fraction of a lead, next to the contour that it touches, on which contact is ignored.
IGNORED_CONTACT = 0.01
# Number of bisections in the search for the longest lead that fits (relative error 0.0001).
LEAD_BISECTIONS = 14
# A lead within this distance of its contour lies on the finished cut [m].
ON_CONTOUR = 1e-6
# Number of points at which the distance of a lead from its contour is measured.
CONTACT_SAMPLES = 17
# Angle of a quarter circle [rad].
QUARTER = np.pi / 2
# Smallest sine of the angle between tangent and `up`. Below it, left and right are undefined.
VERTICAL = 1e-6
# Largest sine of the angle by which a contour may turn at a vertex towards the side of an arc lead.
# With a larger angle, the contour would cross the arc where contact is not ignored.
MAX_INWARD_TURN = 0.005


class LeadPlacement:
    """Lays the leads of a program's contours in the waste, so that they cross no cut contour.

    - `contours`: the contours before they get overlaps and leads.
    - `process`: the process with leads.
    - `left_out`: further contours, which are not run, but decide which contours are holes.
    """

    def __init__(
        self, contours: Sequence[Contour], process: Process, left_out: Sequence[Contour] = ()
    ) -> None:
        # All contours, also those that are not run.
        self._contours = (*contours, *left_out)
        self._process = process
        # Waste side of each contour.
        self._sides = ["left"] * len(contours)
        if any(x.side == WASTE for x in process.leads):
            self._sides = waste_sides(self._contours, process)
        self._cut = cut_contours(self._contours, process)
        # Pieces of all cut contours and the contours' boxes; computed when they are needed first.
        self._pieces_and_boxes: tuple[FloatArray, FloatArray] | None = None
        # Leads that are shorter than requested: fraction of the requested length, and description.
        self._shortened: list[tuple[float, str]] = []

    def place_lead(
        self, number: int, path: Path, lead: Lead, length: float, *, after: bool
    ) -> Path:
        """Return the lead-in or the lead-out of contour `number`.

        - `path`: the contour with its overlap.
        - `length`: requested length [m]; a lead of automatic length is shortened until it fits.
        - `after`: true for the lead-out.
        """
        contour = self._contours[number]
        side = self._sides[number] if lead.side == WASTE else lead.side
        beyond = self._tangent_beyond(contour, path, after)

        def lead_with(length: float) -> Path:
            return lead_path(
                path, length, lead.shape, side, self._process.up, after=after, beyond=beyond
            )

        full_lead = lead_with(length)
        is_waste_arc = lead.shape == "arc" and lead.side == WASTE and self._cut[number]
        weaves = self._process.of_contour(contour).weave is not None
        cuts = self._cuts_on_line(contour, lead) and self._cut[number]
        must_fit = ((is_waste_arc and not weaves) or cuts) and self._has_area(contour)
        if not must_fit or self._fits_in_waste(full_lead, after):
            return full_lead
        if cuts and _lies_on(full_lead, contour.path):
            return full_lead
        fits = 0.0
        too_long = length
        for _ in range(LEAD_BISECTIONS):
            middle = (fits + too_long) / 2
            in_waste = self._fits_in_waste(lead_with(middle), after)
            fits, too_long = (middle, too_long) if in_waste else (fits, middle)
        called = contour_called(contour, number)
        kind = "lead-out" if after else "lead-in"
        location = f"{called} (layer {contour.layer})" if contour.layer else called
        if not fits and cuts:
            raise InvalidInput(
                f"{location}: a straight {kind} with the process on would cut into the part, "
                f"because it continues along the tangent at the {'end' if after else 'start'} of "
                "the contour. Choose shape: arc, which lies in the waste, or remove active: true.",
                needed=length,
                allowed=0.0,
            )
        if not fits:
            raise InvalidInput(
                f"{location}: an arc {kind} does not fit into the waste at the "
                f"{'end' if after else 'start'} of the contour. Choose another start point "
                "(process.begin).",
                needed=length,
                allowed=0.0,
            )
        if lead.length is not None:
            raise InvalidInput(
                f"{location}: a {kind} of {1e3 * length:.4g} mm crosses a contour or leaves the "
                f"waste. The longest {kind} that fits is {1e3 * fits:.4g} mm.",
                needed=length,
                allowed=fits,
            )
        description = f"the {kind} of {location}: {1e3 * fits:.4g} instead of {1e3 * length:.4g} mm"
        self._shortened.append((fits / length, description))
        return lead_with(fits)

    def _cuts_on_line(self, contour: Contour, lead: Lead) -> bool:
        """Return whether the process cuts through the material along a straight lead."""
        if lead.shape != "line" or lead.side != WASTE or not lead.active:
            return False
        process = self._process.of_contour(contour)
        other_leads = (process.lead_in, process.lead_out)
        has_waste_arc = any(
            x is not None and x.shape == "arc" and x.side == WASTE for x in other_leads
        )
        return bool(process.kerf) or process.pierce is not None or has_waste_arc

    def _has_area(self, contour: Contour) -> bool:
        """Return whether a contour encloses an area, on one side of which the waste is."""
        area = float(find_nesting([contour], self._process.up).areas[0])
        return abs(area) > THIN * contour.path.length

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence on leads that are too short to reach the speed; empty without such leads."""
        if not self._shortened:
            return ()
        count = count_noun(len(self._shortened), "lead")
        return (
            "Leads are shorter than the tool needs to reach its speed, because longer leads cross "
            f"a contour or leave the waste ({count}). The shortest is {min(self._shortened)[1]}.",
        )

    def _tangent_beyond(self, contour: Contour, path: Path, after: bool) -> FloatArray | None:
        """Return the contour's unit tangent beyond a vertex at a lead; None without a vertex."""
        outline = contour.path
        # A contour with an overlap does not end at its start point.
        if not outline.segments.closed:
            return None
        nearest = outline.project(path(path.length if after else 0.0)[None])
        if nearest.distance[0] > 2 * REPEATED_POINT:
            return None
        s = float(outline.breaks[np.argmin(np.abs(outline.breaks - nearest.s[0]))])
        if abs(s - nearest.s[0]) > 2 * REPEATED_POINT:
            return None
        if after:
            return outline(0.0 if s == outline.length else s, 1)
        return outline(s or outline.length, 1, side="left")

    def _fits_in_waste(self, lead: Path, after: bool) -> bool:
        """Return whether a lead crosses no cut contour and its free end lies in the waste.

        - `after`: true for a lead-out.
        """
        lead = lead.reversed() if after else lead
        up = self._process.up
        cut = [x for x, is_cut in zip(self._contours, self._cut, strict=True) if is_cut]
        if self._pieces_and_boxes is None:
            tables = [_tabulate_pieces(x.path, up) for x in cut]
            self._pieces_and_boxes = (
                np.concatenate(tables),
                np.array([_bounding_box(x) for x in tables]),
            )
        pieces, boxes = self._pieces_and_boxes
        lead_pieces = _tabulate_pieces(lead, up)
        tip = lead_pieces[0, :2]
        # Only pieces within reach of the lead are tested: if a piece and the lead meet, their
        # starts are at most the sum of both lengths apart.
        apart = np.linalg.norm(pieces[:, :2] - tip, axis=1)
        near = pieces[apart <= pieces[:, LENGTH] + lead.length + REPEATED_POINT]
        pairs, distances = find_crossings(np.concatenate([lead_pieces, near]))
        # A contact is a crossing of a piece of the lead, which come first, and another piece.
        lead_column = np.argmin(pairs, axis=1)[:, None]
        lead_piece = pairs.min(axis=1)
        is_contact = (lead_piece < len(lead_pieces)) & (pairs.max(axis=1) >= len(lead_pieces))
        lead_distances = np.take_along_axis(distances, lead_column, 1)[:, 0]
        begins = np.cumsum(lead_pieces[:, LENGTH]) - lead_pieces[:, LENGTH]
        contacts = lead_distances[is_contact] + begins[lead_piece[is_contact]]
        if (contacts < (1 - IGNORED_CONTACT) * lead.length).any():
            return False
        enclosing = np.nonzero(((boxes[:, 0] <= tip) & (tip <= boxes[:, 1])).all(axis=1))[0]
        contains = find_nesting([*(cut[i] for i in enclosing), Contour(path=lead)], up).contains
        return bool(contains[:, -1].sum() % 2 == 0)


def _lies_on(lead: Path, outline: Path) -> bool:
    """Return whether a lead runs along its contour, which is cut anyway."""
    points = lead(np.linspace(0.0, lead.length, CONTACT_SAMPLES))
    return float(outline.project(points).distance.max()) <= ON_CONTOUR


def _bounding_box(pieces: FloatArray) -> FloatArray:
    """Return the lower and upper corner of a box around pieces [m], (2, 2)."""
    starts = pieces[:, :2]
    lengths = pieces[:, LENGTH:]
    return np.stack([(starts - lengths).min(axis=0), (starts + lengths).max(axis=0)])


def _tabulate_pieces(path: Path, up: FloatArray) -> FloatArray:
    """Return a path seen from above as pieces (offset_curves.py), (n, 6)."""
    chords = find_chords(path, up)
    starts = chords[:, :2]
    ends = chords[:, 2:4]
    centers = chords[:, 4:6]
    radii = chords[:, 6]
    turns = chords[:, 7]
    bent = turns != 0
    curvatures = np.where(bent, turns / np.where(bent, radii, 1.0), 0.0)
    # The tangent of an arc is perpendicular to its radius.
    outward = (starts - centers) * curvatures[:, None]
    arc_tangents = np.column_stack([-outward[:, 1], outward[:, 0]])
    chord_lengths = np.linalg.norm(ends - starts, axis=1)
    chord_directions = (ends - starts) / chord_lengths[:, None]
    tangents = np.where(bent[:, None], arc_tangents, chord_directions)
    half_turns = np.arcsin(np.minimum(chord_lengths * np.abs(curvatures) / 2, 1.0))
    lengths = chord_lengths / np.sinc(half_turns / np.pi)
    return np.column_stack([starts, tangents, curvatures, lengths])


def lead_path(
    path: Path,
    length: float,  # Length of the lead [m]
    shape: str,
    side: str,  # Side of the path on which an arc lies, seen in the direction of travel
    up: FloatArray,  # In space, the upward direction, which defines left and right, (3,)
    *,
    after: bool,  # True for the lead-out
    beyond: FloatArray | None = None,
) -> Path:
    """Return the lead-in before a path, or the lead-out after it.

    If the contour turns towards the side of the arc at this vertex, the lead becomes a line along
    the bisector, because a tangent arc would cross the contour.

    `beyond` is the unit tangent of a closed contour on the other side of the vertex that the lead
    touches.
    """
    s = path.length if after else 0.0
    direction = "left" if after else "right"
    point = path(s)
    tangent = path(s, 1, side=direction)
    row = -1 if after else 0
    if shape == "arc" and beyond is not None:
        entering, leaving = (tangent, beyond) if after else (beyond, tangent)
        if _side_vector(entering, side, up) @ leaving > MAX_INWARD_TURN:
            inwards = (leaving - entering) / np.linalg.norm(leaving - entering)
            shape = "line"
            tangent = inwards if after else -inwards
    if shape == "line":
        start = point if after else point - length * tangent
        normal = np.zeros_like(tangent)
        curvature = 0.0
        start_tangent = tangent
    else:
        curvature = QUARTER / length
        normal = _side_vector(tangent, side, up)
        start = point
        start_tangent = tangent
        if not after:
            # A lead-in is on the same circle: the quarter circle that ends at the point.
            start = point - (tangent - normal) / curvature
            start_tangent = -normal
            normal = tangent
    lead = Path(
        segments=Segments(
            starts=start[None],
            tangents=start_tangent[None],
            normals=normal[None],
            curvatures=np.array([curvature]),
            lengths=np.array([length]),
            speeds=path.speeds[[row]],
            tolerances=path.tolerances[[row]],
            tags=np.array(["lead-out" if after else "lead-in"], dtype=object),
        )
    )
    if path.orientation is None:
        return lead
    # The lead has the orientation of the path where it touches the path.
    rotation = path.orientation(s, side=direction)
    return replace(lead, orientation=_lead_orientation(path.orientation, rotation, lead, after))


def _side_vector(tangent: FloatArray, side: str, up: FloatArray) -> FloatArray:
    """Return the unit vector perpendicular to a tangent, towards `side`."""
    if len(tangent) == 2:
        normal = np.array([-tangent[1], tangent[0]])
    else:
        normal = np.cross(up, tangent)
        size = float(np.linalg.norm(normal))
        if size < VERTICAL:
            raise InvalidInput(
                "A lead in the shape of an arc has no side where the contour is parallel to the "
                "direction up. Use the shape line."
            )
        normal = normal / size
        normal -= (normal @ tangent) * tangent
        normal /= np.linalg.norm(normal)
    return np.asarray(normal if side == "left" else -normal)


def _lead_orientation(
    orientation: Orientation, rotation: FloatArray, lead: Path, after: bool
) -> Orientation:
    """Orient the tool along a lead: along the tangent, or constantly as on the path.

    - `orientation`: orientation of the path.
    - `rotation`: rotation matrix of the tool where the lead touches the path, (3, 3).
    - `after`: true for a lead-out.
    """
    rate = np.zeros(3)
    if orientation.follows and lead.curvatures[0] > 0:
        rate = tangent_rates(lead.segments)[0]
    start = rotation
    if not after and rate.any():
        start = exp(-rate[None] * lead.length)[0] @ rotation
    along_lead = Orientation.even(
        lead.lengths,
        start[None],
        rate[None],
        axis_only=orientation.axis_only,
        follows=orientation.follows,
    )
    return along_lead.with_cone(orientation.cone)
