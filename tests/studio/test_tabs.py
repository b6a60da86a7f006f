"""Who listens, and what a page that comes later gets."""

from __future__ import annotations

from armcontour.studio import tabs as module
from armcontour.studio.tabs import MOST_FILES, Tabs
from armcontour.studio.wire import Frame


class Page:
    """A page that keeps what it hears."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def send(self, data: bytes, replaces: str | None = None) -> None:
        self.frames.append(Frame.unpack(data))

    @property
    def heard(self) -> list[tuple[str, str | None, int | None]]:
        return [(x.kind, x.header.get("of"), x.header["seq"]) for x in self.frames]


def test_every_page_hears_the_number_of_its_own_message() -> None:
    tabs, one, other = Tabs(), Page(), Page()
    tabs.join(one)
    tabs.join(other)
    assert tabs.hear(one, {"seq": 7}) and not tabs.hear(Page(), {"seq": 9})
    assert tabs.hear(other, {"seq": True})
    before = tabs.answers
    tabs.hear(one, {"seq": 8})
    tabs.tell(Frame("notice", {"rev": 3}))
    tabs.tell(Frame("notice", {"rev": 3}), answers=before)
    tabs.tell(Frame("diff"), to=other)
    assert one.heard == [("notice", None, 8), ("notice", None, 7)]
    assert other.heard == [("notice", None, None)] * 2 + [("diff", None, None)]
    assert one.frames[0].header["rev"] == 3
    tabs.leave(one)
    tabs.tell(Frame("notice"))
    assert len(one.frames) == 2 and not tabs.hear(one, {})


def test_a_page_that_comes_later_gets_what_is_not_out_of_date() -> None:
    tabs, page = Tabs(), Page()
    for of in ("live", "compare"):
        for kind in ("picture", "executed"):
            tabs.tell(Frame(kind, {"of": of}))
    tabs.tell(Frame("notice"))
    tabs.tell(Frame("picture", {"of": "live"}))
    tabs.tell(Frame("refusal", {"of": "live", "dropped": True}))
    tabs.join(page)
    assert [x[:2] for x in page.heard] == [
        ("picture", "live"),
        ("picture", "compare"),
        ("executed", "compare"),
    ]
    tabs.tell(Frame("document", {"compare": None}))
    tabs.join(later := Page())
    assert [x[:2] for x in later.heard] == [("picture", "live"), ("document", None)]


def test_the_newest_files_are_kept() -> None:
    tabs = Tabs()
    numbers = [tabs.keep_file(f"{k}.csv", "text/csv", b"%d" % k) for k in range(MOST_FILES + 2)]
    assert list(tabs.files) == numbers[2:]
    assert tabs.files[numbers[-1]].data == b"%d" % (MOST_FILES + 1)


def test_large_files_are_kept_only_as_far_as_there_is_room(monkeypatch) -> None:
    monkeypatch.setattr(module, "MOST_BYTES", 100)
    tabs = Tabs()
    first, second = (tabs.keep_file("x.csv", "text/csv", bytes(60)) for _ in range(2))
    assert list(tabs.files) == [second] and first != second
    third = tabs.keep_file("x.csv", "text/csv", bytes(200))
    assert list(tabs.files) == [third] and len(tabs.files[third].data) == 200
