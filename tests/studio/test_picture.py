"""Plans, and programs without one, as frames for the screen."""

import numpy as np
import pytest
from tests.studio.conftest import PAPER
from tests.studio.drawn import packed, uv

from armcontour.evaluation import check
from armcontour.studio.line import NOTHING
from armcontour.studio.picture import MOST_POINTS, drawing_frame, picture_frame
from armcontour.studio.preview import Previewer


@pytest.fixture(scope="module")
def shown(plans, view):
    return plans["optimal"], packed(picture_frame(plans["optimal"], view))


@pytest.fixture(scope="module")
def gasket(gasket_plan, view):
    return gasket_plan, packed(picture_frame(gasket_plan, view))


class TestPicture:
    def test_points_are_on_the_path_with_their_times_and_speeds(self, shown, view):
        planned, frame = shown
        s, a = frame.arrays["path_s"].astype(float), frame.arrays
        path, trajectory = planned.path.path, planned.trajectory
        inside = np.clip(s, 0, path.length)
        np.testing.assert_allclose(
            a["path"] + view.centre, uv(view, path(inside)), rtol=0, atol=1e-7
        )
        np.testing.assert_allclose(a["xyz"][:, :2], path(inside), rtol=0, atol=1e-7)
        # Near rests, small differences of s are large ones of t.
        times = np.clip(a["path_t"].astype(float), 0, trajectory.duration)
        np.testing.assert_allclose(trajectory.s(times), inside, rtol=0, atol=1e-6)
        np.testing.assert_allclose(a["speed"], trajectory.speed_at(inside), rtol=0, atol=2e-4)
        assert (a["assigned"] == np.float32(0.15)).all()
        assert frame.header["duration"] == trajectory.duration
        assert frame.header["plane"]["flat"] is True

    def test_colours_are_what_explain_says(self, shown):
        planned, frame = shown
        bindings = planned.explanation.bindings
        random = np.random.default_rng(3).uniform(0, planned.path.length, 200)
        a, names = frame.arrays, [x["name"] for x in frame.header["limits"]]
        drawn = a["path_s"].astype(float)
        # Not where 32 bits cannot tell on which side of a change a place is.
        edges = np.array([x.s[0] for x in bindings])
        near = np.abs(random[:, None] - edges).min(axis=1) < 1e-6
        assert near.sum() < 20
        for s in random[~near]:
            (why,) = (x.name for x in bindings if x.s[0] <= s < x.s[1])
            k = a["binding"][np.searchsorted(drawn, s, side="right") - 1]
            assert (names[k] if k != NOTHING else "nothing") == why

    def test_kinds_group_the_limits(self, shown):
        _, frame = shown
        kinds = {x["name"]: x["kind"] for x in frame.header["limits"]}
        assert kinds["joint 2 acceleration"] == "acceleration"
        assert kinds["assigned velocity"] == "speed"
        assert sum(x["time"] for x in frame.header["shares"]) == pytest.approx(
            frame.header["duration"], rel=1e-9
        )

    def test_charts_have_the_shares_of_the_limits(self, shown):
        planned, frame = shown
        a, limits = frame.arrays, planned.run.limits
        assert (np.diff(a["t"]) >= 0).all() and a["t"][0] == 0
        assert a["q"].dtype == np.float64
        found = check(planned.trajectory, planned.job.arm, limits)["joint_acceleration"]
        assert np.abs(a["usage_a"]).max() == pytest.approx(found.ratio, abs=1e-3)
        middle = len(a["t"]) // 2
        np.testing.assert_allclose(
            a["q"][middle], planned.trajectory(float(a["t"][middle])), rtol=0, atol=1e-5
        )
        low = a["usage_a"].min(axis=0)
        assert (low < 0).all()

    def test_corners_can_be_grabbed(self, shown, view):
        planned, frame = shown
        corners = frame.header["corners"]
        assert [x["vertex"] for x in corners] == [1, 2]
        for x, point in zip(corners, planned.objective.path.vertices[1:3], strict=True):
            np.testing.assert_allclose(x["corner"], uv(view, point), atol=1e-12)
            gap = np.linalg.norm(np.subtract(x["apex"], x["corner"]))
            assert gap == pytest.approx(x["error"], rel=1e-9)
            assert x["allowed"] == pytest.approx(5e-3)

    def test_corners_know_their_waypoints_and_their_own_tolerance(self, previewer, paper, view):
        paper["corners"] = {"tolerance": "5 mm", "at": {3: "1 mm"}}
        lead = {"length": "5 mm", "shape": "line", "side": "left"}
        paper |= {"process": {"lead_in": lead}, "runs": {"optimal": {}}, "published": None}
        del paper["experiment"]
        planned = previewer.plan(paper, "optimal")
        corners = packed(picture_frame(planned, view)).header["corners"]
        assert [(x["vertex"], x["waypoint"]) for x in corners] == [(2, 1), (3, 2)]
        assert [x["allowed"] for x in corners] == pytest.approx([5e-3, 1e-3])
        assert corners[1]["error"] == pytest.approx(1e-3)

    def test_corners_of_drawings_are_no_waypoints(self, gasket):
        _, frame = gasket
        assert {x["waypoint"] for x in frame.header["corners"]} == {None}

    def test_shortfalls_are_where_the_tool_is_slow(self, shown, view):
        planned, frame = shown
        assert len(frame.header["shortfalls"]) == len(planned.explanation.shortfalls) > 0
        for x in frame.header["shortfalls"]:
            point = planned.path.path(x["s"])
            np.testing.assert_allclose(x["uv"], uv(view, point), atol=1e-12)
            assert x["t"] == pytest.approx(float(planned.trajectory.time_at(x["s"])))

    @pytest.mark.parametrize("name", ["proposed", "conventional"])
    def test_other_methods_have_no_colours_and_say_so(self, plans, view, name):
        frame = packed(picture_frame(plans[name], view))
        assert (frame.arrays["binding"] == NOTHING).all()
        assert not frame.header["limits"] and not frame.header["shares"]
        method = plans[name].run.timing
        assert any(
            x.startswith(f"plans of the method {method} have no") for x in frame.header["notes"]
        )
        assert len(frame.arrays["t"]) >= 200


class TestPrograms:
    def test_the_arm_is_played_closely(self, plans, gasket_plan, view):
        for planned in (*plans.values(), gasket_plan):
            a, trajectory = packed(picture_frame(planned, view)).arrays, planned.trajectory
            t = np.linspace(0, trajectory.duration, 5001)
            played = np.transpose([np.interp(t, a["t"], q) for q in a["q"].T])
            np.testing.assert_allclose(played, trajectory(t), rtol=0, atol=1e-4)

    def test_contours_are_parts_of_the_arrays(self, gasket, view):
        planned, frame = gasket
        contours, a = frame.header["contours"], frame.arrays
        assert len(contours) == len(planned.path.contours)
        assert contours[0]["from"] == 0 and contours[-1]["to"] == len(a["path"])
        for x, contour in zip(contours, planned.path.contours, strict=True):
            own = a["path"][x["from"] : x["to"]] + view.centre
            np.testing.assert_allclose(own[0], uv(view, contour.path(0.0)), atol=1e-7)
            np.testing.assert_allclose(
                own[-1], uv(view, contour.path(contour.path.length)), atol=1e-7
            )
            assert x["name"] == contour.name
        breaks = a["objective_breaks"]
        assert len(breaks) == len(contours) + 1 and breaks[-1] == len(a["objective"])

    def test_the_kerf_lies_beside_the_drawn_contours(self, previewer, square, view):
        square["path"] = {"file": "gasket.dxf", "orientation": {"axis": [0, 0, -1]}}
        lead = {"length": "2 mm", "shape": "arc"}
        square["process"] = {
            "kerf": "1 mm",
            "by_layer": {"MARK": {"kerf": None, "lead_in": None}},
            "lead_in": lead | {"active": True},
            "lead_out": lead,
        }
        planned = previewer.plan(square)
        frame = packed(picture_frame(planned, view))
        a, cut = frame.arrays, [x for x in planned.path.contours if x.layer == "CUT"]
        assert frame.header["kerfs"] == [1e-3] * len(cut)
        parts = np.split(a["cut"], a["cut_breaks"][1:-1])
        # Along the active lead-in, without the lead-out.
        for part, contour in zip(parts, cut, strict=True):
            ends = contour.path(np.array([0.0, contour.at_work[1]]))
            np.testing.assert_allclose(part[[0, -1]] + view.centre, uv(view, ends), atol=1e-7)
        drawn = np.split(a["drawn"], a["drawn_breaks"][1:-1])
        given = [x for x in planned.job.program.contours if x.layer == "CUT"]
        for part, contour in zip(drawn, given, strict=True):
            begin = uv(view, contour.path(0.0)) - view.centre
            np.testing.assert_allclose(part[0], begin, atol=1e-7)
        assert "cut" not in packed(picture_frame(previewer.plan(PAPER, "optimal"), view)).arrays

    def test_colours_are_those_of_every_contour(self, gasket):
        planned, frame = gasket
        names = [x["name"] for x in frame.header["limits"]]
        a = frame.arrays
        for x, span in zip(frame.header["contours"], planned.trajectory.contour_spans, strict=True):
            own = a["binding"][x["from"] : x["to"] - 1]
            told = {y.name for y in planned.explanation.bindings if span.s[0] <= y.s[0] < span.s[1]}
            assert {names[k] if k != NOTHING else "nothing" for k in own} == told

    def test_curves_are_drawn_round(self, gasket):
        planned, frame = gasket
        path_s, starts = frame.arrays["path_s"].astype(float), planned.path.breaks
        size = np.ptp(frame.arrays["path"], axis=0).max()
        for x, start, end in zip(planned.path.contours, starts, starts[1:], strict=False):
            s = np.clip(path_s[(path_s >= start) & (path_s <= end)] - start, 0, x.path.length)
            ends, middle = x.path(s), x.path((s[1:] + s[:-1]) / 2)
            # At most a quarter of a pixel of a picture of 500 pixels.
            assert np.linalg.norm(middle - (ends[1:] + ends[:-1]) / 2, axis=1).max() < size / 2000

    def test_rapids_lead_from_contour_to_contour(self, gasket):
        planned, frame = gasket
        a = frame.arrays
        count = sum(x.kind == "rapid" for x in planned.trajectory.spans)
        assert len(a["rapid_breaks"]) == count + 1
        rapids = np.split(a["rapid_xyz"], a["rapid_breaks"][1:-1])
        for rapid, before, after in zip(
            rapids, planned.path.contours, planned.path.contours[1:], strict=False
        ):
            np.testing.assert_allclose(rapid[0], before.path(before.path.length), atol=1e-6)
            np.testing.assert_allclose(rapid[-1], after.path(0.0), atol=1e-6)

    @pytest.mark.parametrize("dwell", ["0 s", "0.2 s"])
    def test_times_of_limits_rapids_and_dwells_add_up(self, previewer, square, view, dwell):
        drawing = {"file": "gasket.dxf", "orientation": {"axis": [0, 0, -1]}}
        data = square | {"path": drawing, "process": {"dwell": dwell}}
        planned = previewer.plan(data)
        frame = packed(picture_frame(planned, view))
        times = {x["name"]: x["time"] for x in frame.header["shares"]}
        assert sum(times.values()) == pytest.approx(frame.header["duration"], rel=1e-9)
        assert "nothing" not in times and times["between two limits"] > 0
        spans = planned.trajectory.spans
        rapid = sum(x.t[1] - x.t[0] for x in spans if x.kind == "rapid")
        assert times["rapids between contours"] == pytest.approx(rapid) and rapid > 0.1
        count = sum(x.kind == "dwell" for x in spans)
        assert times.get("dwells", 0.0) == pytest.approx(float(dwell.split()[0]) * count)

    def test_an_arm_below_its_base_is_a_warning(self, previewer, square, view):
        def warned(height):
            path = square["path"] | {"frame": {"position": [0, 0, height]}}
            planned = previewer.plan(square | {"path": path})
            arm = planned.job.arm
            points = arm.links(planned.trajectory(np.linspace(0, 1, 50)))
            lowest = (points - arm.chain.base.position)[..., 2].min()
            warnings = picture_frame(planned, view).header["warnings"]
            return lowest < -0.05, any("below its base" in x for x in warnings)

        assert warned(0.0) == (False, False)
        assert warned(-0.3) == (True, True)

    def test_torque_is_shown_where_it_is_limited(self, gasket):
        planned, frame = gasket
        limits = planned.run.limits
        assert ("usage_torque" in frame.arrays) == (limits.joint_torque is not None)


def zigzag(count):
    """A path of many lines."""
    k = np.arange(count + 1)
    points = np.stack([0.3 + 1e-5 * k % 0.05, 0.2 + 0.01 * (k % 2)], axis=1)
    return points.tolist()


class TestLongPrograms:
    def test_they_are_drawn_before_they_are_planned(self, paper, view):
        previewer = Previewer()
        path = {"points": zigzag(30_000)}
        data = paper | {"path": path}
        assert previewer.is_long(data) and not previewer.is_long(paper)
        frame = packed(drawing_frame(previewer.drawn(data), view))
        points = frame.arrays["objective"]
        assert 1000 < len(points) <= MOST_POINTS * 1.01
        assert frame.header["duration"] is None and frame.header["planned"] is False
        given = uv(view, np.array(path["points"]))
        for extreme in (np.min, np.max):
            np.testing.assert_allclose(
                extreme(points + view.centre, axis=0), extreme(given, axis=0), atol=1e-7
            )
