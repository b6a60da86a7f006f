"""Pages of the server."""

from __future__ import annotations

import asyncio
from typing import Any

from armcontour.studio.desk import MOST_WAITING, Tab


def test_a_page_that_reads_slowly_gets_the_newest() -> None:
    async def talk() -> list[bytes]:
        tab, sent = Tab(), list[bytes]()
        for k in range(100):
            tab.send(b"%d" % k, "picture")
        tab.send(b"notice")
        tab.send(b"again", "picture")

        async def send(message: Any) -> None:
            sent.append(message["bytes"])

        writing = asyncio.create_task(tab.write(send))
        while len(sent) < 2:
            await asyncio.sleep(0)
        writing.cancel()
        return sent

    assert asyncio.run(talk()) == [b"notice", b"again"]


def test_a_page_that_never_reads_is_let_go() -> None:
    async def talk() -> None:
        tab = Tab()
        for _ in range(MOST_WAITING + 1):
            tab.send(b"")
        await tab.write(lambda message: asyncio.sleep(0))

    asyncio.run(asyncio.wait_for(talk(), 20))
