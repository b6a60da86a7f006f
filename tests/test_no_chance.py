"""No test depends on chance: on a clock, a signal, a killed process, a sleep or a time limit."""

from __future__ import annotations

import ast
import re
from pathlib import Path

TESTS = Path(__file__).parent
MODULES = {"time", "resource", "sched"}
METHODS = {
    *("kill", "killpg", "terminate", "send_signal", "raise_signal", "sleep"),
    *("alarm", "setitimer", "pthread_kill"),
    *("now", "utcnow", "today", "monotonic", "perf_counter", "process_time"),
}
WAITS = {"wait", "join", "wait_for", "result", "acquire", "communicate"}
IN_TEXT = re.compile(r"\b(sleep|monotonic|perf_counter|process_time|setitimer|kill)\(")


def offence(node: ast.AST, drives_a_browser: bool) -> str | None:
    """Why a part of a test depends on chance; None if it does not."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return "code in a text" if IN_TEXT.search(node.value) else None
    if not isinstance(node, ast.Call):
        return None
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    first = node.args[0].value if node.args and isinstance(node.args[0], ast.Constant) else None
    if isinstance(node.func, ast.Attribute) and getattr(node.func.value, "id", "") in MODULES:
        return f"{node.func.value.id}.{name}()"  # type: ignore[attr-defined]
    if name in METHODS and not (name == "sleep" and first == 0):
        return f"{name}()"
    if name == "Timer" and isinstance(first, (int, float)):
        return "Timer()"
    if drives_a_browser:
        return None
    if any(x.arg == "timeout" for x in node.keywords):
        return f"{name}(timeout=...)"
    count = 2 if name == "wait_for" else 1
    last = node.args[-1] if len(node.args) == count else None
    is_number = isinstance(last, ast.Constant) and type(last.value) in (int, float)
    is_method = isinstance(node.func, ast.Attribute) or name == "wait_for"
    return f"{name}({last.value})" if is_number and is_method and name in WAITS else None


def offences(text: str, *, drives_a_browser: bool = False) -> list[tuple[int, str]]:
    """Lines and reasons of a test file."""
    pairs = [
        (getattr(node, "lineno", 0), offence(node, drives_a_browser))
        for node in ast.walk(ast.parse(text))
    ]
    return [(line, why) for line, why in pairs if why]


def test_no_test_depends_on_chance():
    messages = []
    for file in sorted(TESTS.rglob("*.py")):
        place = file.relative_to(TESTS)
        if place.parts[0] == "slow" or file == Path(__file__):
            continue
        file_offences = offences(
            file.read_text(encoding="utf-8"), drives_a_browser="browser" in place.parts
        )
        messages += [f"tests/{place}:{line}: {why}" for line, why in file_offences]
    assert not messages, "Move it to tests/slow, or rewrite it:\n" + "\n".join(messages)
