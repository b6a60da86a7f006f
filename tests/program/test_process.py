"""Values of a process."""

import pickle
from collections.abc import Callable, Iterator

import armcontour as ac
from armcontour import InvalidInput
from armcontour.program import Process


def test_a_process_goes_to_other_processes() -> None:
    process = Process(overlap=2e-3, by_layer={"cut": {"overlap": 1e-3}})
    again = pickle.loads(pickle.dumps(process))
    assert again.overlap == 2e-3 and again.of_layer("cut").overlap == 1e-3
    assert dict(again.by_layer) == dict(process.by_layer)


def test_a_text_is_no_list_of_outputs(refuses: Callable[..., None]) -> None:
    # Its letters would be names of outputs that do not exist, and the laser on in rapids.
    refuses(
        lambda: Process(off_between="spindle"),  # type: ignore[arg-type]
        InvalidInput,
        "off_between of a process must be a list of names of outputs, not 'spindle'.",
    )


def test_a_switch_by_its_name_alone_is_refused(refuses: Callable[..., None]) -> None:
    refuses(
        lambda: Process(switch="laser"),  # type: ignore[arg-type]
        InvalidInput,
        "switch of a process needs a Switch, not str.",
    )


def test_a_pierce_needs_a_switch_and_an_active_lead(refuses: Callable[..., None]) -> None:
    pierce, laser = ac.Pierce(time=0.3), ac.Switch(name="laser")
    idle = ac.Lead(length=5e-3)
    refuses(lambda: Process(pierce=pierce), InvalidInput, "switch")
    refuses(lambda: Process(pierce=pierce, switch=laser, lead_in=idle), InvalidInput, "active")
    refuses(lambda: ac.Pierce(time=0.0), InvalidInput, "time of a pierce")
    refuses(lambda: ac.Pierce(time=0.1, height=-1e-3), InvalidInput, "height of a pierce")
    high = Process(pierce=ac.Pierce(time=0.1, height=1e-3), switch=laser)
    line = ac.Path.polyline([(0.3, 0.1), (0.4, 0.1)])
    refuses(lambda: ac.prepare(line, high), InvalidInput, "plane")
    marked = Process(pierce=pierce, switch=laser, by_layer={"MARK": {"pierce": None}})
    assert marked.of_layer("CUT").begins_on and not marked.of_layer("MARK").begins_on


def test_events_may_come_one_by_one() -> None:
    def events() -> Iterator[ac.Event]:
        yield ac.Event(name="gas", s=0.01)

    line = ac.Path.polyline([(0.3, 0.1), (0.4, 0.1)])
    assert len(ac.Contour(path=line, events=events()).events) == 1  # type: ignore[arg-type]
    assert len(Process(events=events()).events) == 1  # type: ignore[arg-type]


def test_a_path_is_prepared_as_a_program_of_one_contour() -> None:
    line = ac.Path.polyline([(0.3, 0.1), (0.4, 0.1)])
    prepared = ac.prepare(line, Process(switch=ac.Switch(name="laser")))
    assert [(x.name, x.value) for x in prepared.contours[0].events] == [
        ("laser", True),
        ("laser", False),
    ]
