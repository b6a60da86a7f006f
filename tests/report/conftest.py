"""A check of every rendered page."""

import re

import pytest


@pytest.fixture(scope="session")
def in_order():
    """Check that a page has these sections in this order, and loads nothing from elsewhere."""

    def check(page, keys):
        places = [page.index(f'<details id="{key}">') for key in keys.split()]
        assert places == sorted(places)
        assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)=", page)

    return check
