"""`tools.size` counts lines and words, and fails above the limits in size.txt."""

from tools import size

CODE = '''"""Docstring."""

# A comment.
def double(x):
    """Docstring
    of two lines."""
    return 2 * x  # A comment.
'''


def test_code_is_counted_without_docstrings_comments_and_generated_pages(tmp_path):
    assert size.code_lines(CODE) == 2
    package = tmp_path / "src/armcontour"
    (package / "static/vendor").mkdir(parents=True)
    for folder in ("tests", "docs/reference"):
        (tmp_path / folder).mkdir(parents=True)
    (package / "a.py").write_text(CODE)
    (package / "static/a.js").write_text("// comment\n\nlet a = 1;\n")
    (package / "static/vendor/b.js").write_text("let b = 1;\n")
    (tmp_path / "tests/test_a.py").write_text("a\n\nb\n")
    (tmp_path / "docs/page.md").write_text("three words here\n")
    (tmp_path / "docs/reference/job_keys.md").write_text("many keys\n")
    assert list(size.count(tmp_path).values()) == [2, 1, 1, 3, 3]


def test_a_size_above_its_limit_fails(monkeypatch, capsys):
    limits = size.read_limits(size.LIMITS.read_text(encoding="utf-8"))
    for excess, code in ((0, 0), (1, 1)):
        monkeypatch.setattr(
            size, "count", lambda x=excess: {**limits, "files": limits["files"] + x}
        )
        assert size.main() == code
    assert "1 too many" in capsys.readouterr().out
