"""Tasks as the other process does them."""

import yaml

from armcontour.studio.tasks.working import do


def quiet(step):
    """Hears nothing."""


def ask(task, data, run, drawings, **options):
    text = data if isinstance(data, str) else yaml.safe_dump(data, sort_keys=False)
    request = {"text": text, "folder": str(drawings), "run": run, "options": options}
    return do(task, request, quiet)
