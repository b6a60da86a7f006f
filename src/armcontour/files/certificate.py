"""Certificates as JSON and CSV, with all data that a repetition needs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour.core.render import plain, units
from armcontour.files.json_text import to_json
from armcontour.studies.certification import Certificate


def certificate_json(certificate: Certificate, files: Sequence[str] = ()) -> str:
    """A certificate as JSON: requirements, results, model, and the data to repeat the plan.

    Args:
        certificate: The certificate.
        files: The files of the result, relative to its folder.
    """
    data, page = certificate.to_data(), plain(certificate.study.to_data(files))
    return to_json(page | {"units": page["units"] | units([data]), "certificate": plain(data)})


def derating_csv(certificate: Certificate) -> str:
    """The derating of a certificate as CSV: a row per interval of arc length with equal derating.

    A row has the share of every joint's acceleration limit that the plan uses, and the largest
    squared speed.
    """
    names = [f"acceleration left {x} [1]" for x in certificate.job.arm.joint_names]
    lines = [",".join(["contour", "from [m]", "to [m]", *names, "largest ds^2 [m^2/s^2]"])]
    for number, contour in enumerate(certificate.contours, start=1):
        derating = contour.derating
        rows = np.column_stack([derating.share, derating.cap])
        first = np.append(True, (rows[1:] != rows[:-1]).any(axis=1))
        start = derating.cells[:-1][first]
        end = np.append(start[1:], derating.cells[-1])
        for a, b, row in zip(start, end, rows[first], strict=True):
            cells = [f"{x!r}" if np.isfinite(x) else "" for x in row.tolist()]
            lines.append(",".join([str(number), repr(float(a)), repr(float(b)), *cells]))
    return "\n".join(lines) + "\n"
