"""Helpers of the tests of the command line."""

import json


def summary(folder):
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))
