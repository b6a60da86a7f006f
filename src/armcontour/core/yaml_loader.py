"""Safe YAML: no repeated keys, a limit for aliases, and the values of YAML 1.2."""

from __future__ import annotations

import math
import re
from typing import Any

import yaml

from armcontour.core.errors import InvalidInput
from armcontour.core.text import LONGEST_NUMBER, parse_number, show

# Longest text [characters]; libyaml reads one million per second. Tables have long paths.
MAX_YAML_LENGTH = 16_000_000
# Largest number of values that aliases may add; an alias repeats all values of its anchor.
MAX_ALIASED = 100_000
# A text counts as one value per this number of characters.
CHARACTERS_PER_VALUE = 80
TAG = "tag:yaml.org,2002:"
# The tag of the key `<<`, whose value is merged into its mapping.
MERGE_TAG = f"{TAG}merge"
INT = re.compile(r"[-+]?[0-9]+\Z")
ENDLESS = re.compile(r"[-+]?\.(?:inf|Inf|INF)\Z|\.(?:nan|NaN|NAN)\Z")
NUMBER = rf"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?\Z|{ENDLESS.pattern}"
# Problems that libyaml reports, and their explanations; `begun` is the number of the line in which
# the wrong construct begins.
PLAIN = {
    "unexpected end of stream": "the quote that begins in line {begun} does not end",
    "cannot start any token": "indent with blanks instead of a tab, and quote a text that begins "
    "with a special character",
    "expected key": "this line is not indented like the lines around it, or has a bracket too many",
    "expected '-'": "this line is not indented like the lines around it",
    "expected ','": "the bracket of line {begun} needs a comma or its end before this",
    "values are not allowed": "this colon is wrong, because the line is indented too far, or a "
    "text with a colon needs quotes",
    "expected ':'": "line {begun} has no colon after its key",
    "nesting depth": "it is nested too deeply",
}


class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Safe loader that rejects repeated keys and aliases that multiply the size of a document."""

    def construct_document(self, node: yaml.Node) -> Any:
        """Check keys and aliases of the document, then construct it."""
        # A value that is written has at least one character.
        if _size(node, {}) > node.end_mark.index + MAX_ALIASED:
            words = f"its aliases add more than {MAX_ALIASED} values. Use fewer aliases"
            raise _node_error(node, words)
        return super().construct_document(node)

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Insert merged keys first, so that explicit keys override them; PyYAML 6.0.4 does not."""
        merged = []
        for value in [value for key, value in node.value if key.tag == MERGE_TAG]:
            # The first mapping of a list overrides the others.
            for part in reversed(value.value) if isinstance(value, yaml.SequenceNode) else [value]:
                if not isinstance(part, yaml.MappingNode):
                    raise _node_error(part, "<< takes a mapping or a list of mappings")
                self.flatten_mapping(part)
                merged += part.value
        node.value = merged + [x for x in node.value if x[0].tag != MERGE_TAG]


def _construct_number(loader: Loader, node: yaml.Node) -> float:
    """Convert a decimal number, infinity or NaN; a later check may reject infinity or NaN."""
    text = str(node.value)
    if ENDLESS.match(text):
        return float(text.replace(".", ""))
    try:
        value = parse_number(text)
    except ValueError:
        words = f"{show(text)} is not a finite number of at most {LONGEST_NUMBER} characters"
        raise _node_error(node, words) from None
    return int(text) if INT.match(text) else value


# PyYAML reads numbers, booleans and dates as in YAML 1.1; off and dates must stay text.
Loader.yaml_implicit_resolvers = {}
for _kind, _pattern, _first in (
    ("null", r"(?:~|null|Null|NULL)?\Z", ["~", "n", "N", ""]),
    ("bool", r"(?:true|True|TRUE|false|False|FALSE)\Z", "tTfF"),
    ("int", INT.pattern, "-+0123456789"),
    ("float", NUMBER, "-+.0123456789"),
    ("merge", r"<<\Z", "<"),
):
    Loader.add_implicit_resolver(TAG + _kind, re.compile(_pattern), list(_first))
for _tag in (f"{TAG}float", f"{TAG}int", "!radians"):
    Loader.add_constructor(_tag, _construct_number)
Loader.add_constructor("!degrees", lambda x, node: math.radians(_construct_number(x, node)))


def load(content: str | bytes, source: str) -> Any:
    """Load the YAML document in a text, or in bytes of UTF-8; `!degrees` converts to radians.

    Raises:
        InvalidInput: The text is too long, is not valid YAML, or repeats keys.
    """
    if len(content) > MAX_YAML_LENGTH:
        raise InvalidInput(
            f"{source} has {len(content) / 1e6:.0f} million characters, more than the "
            f"limit of {MAX_YAML_LENGTH / 1e6:.0f} million for YAML. Write a long path to a "
            "separate CSV file."
        )
    try:
        text = content if isinstance(content, str) else content.decode("utf-8")
        return yaml.load(text, Loader=Loader)
    except RecursionError:
        problem = "it is nested too deeply"
    except yaml.MarkedYAMLError as error:
        problem = _describe_error(error)
    except (ValueError, TypeError, yaml.YAMLError) as error:
        problem = " ".join(str(error).split())
    raise InvalidInput(f"{source} is not valid YAML: {problem}.")


def _size(node: yaml.Node, sizes: dict[yaml.Node, int]) -> int:
    """Count the values in a node, with those that aliases repeat; refuse repeated keys."""
    if sizes.get(node) == 0:
        raise _node_error(node, "an alias is inside its own anchor")
    if node not in sizes:
        sizes[node] = 0
        parts = node.value
        size = 1
        if isinstance(node, yaml.ScalarNode):
            parts = []
            size = 1 + len(node.value) // CHARACTERS_PER_VALUE
        elif isinstance(node, yaml.MappingNode):
            parts = [x for pair in node.value for x in pair]
            names = set()
            for key in parts[::2]:
                name = (key.tag, str(key.value))
                if name in names:
                    raise _node_error(key, f"the key {show(key.value)} is repeated")
                names.add(name)
        sizes[node] = size + sum(_size(x, sizes) for x in parts)
    return sizes[node]


def _node_error(node: yaml.Node, problem: str) -> yaml.constructor.ConstructorError:
    """Make the error at the position of a node."""
    return yaml.constructor.ConstructorError(None, None, problem, node.start_mark)


def _describe_error(error: Any) -> str:
    """Describe problem, line and column of an error."""
    mark = error.problem_mark
    begun = error.context_mark or error.problem_mark
    problem = next((x for key, x in PLAIN.items() if key in error.problem), error.problem)
    problem = problem.replace("{begun}", str(begun.line + 1))
    return f"{problem} (line {mark.line + 1}, column {mark.column + 1})"
