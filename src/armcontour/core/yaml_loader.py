"""Safe YAML: no repeated keys, a limit for aliases, and the numbers of YAML 1.2."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import yaml

from armcontour.core.errors import InvalidInput
from armcontour.core.text import LONGEST, parse_number, show

# Longest text [characters]; PyYAML's parser reads 0.3 million per second. Tables have long paths.
MAX_CHARACTERS = 16_000_000
# Largest number of values that aliases add; an alias repeats all values of its anchor.
MAX_ALIASED = 100_000
# Number of characters of text that count as one value.
CHARACTERS_PER_VALUE = 80
FLOAT = "tag:yaml.org,2002:float"
INT = "tag:yaml.org,2002:int"
BOOL = "tag:yaml.org,2002:bool"
STR = "tag:yaml.org,2002:str"
TIMESTAMP = "tag:yaml.org,2002:timestamp"
VALUE = "tag:yaml.org,2002:value"
# The key whose value is merged into its mapping, and the tag of this key.
MERGE, MERGE_TAG = "<<", "tag:yaml.org,2002:merge"
# Possessive quantifiers prevent backtracking, so that the time is linear in the length.
WHOLE = re.compile(r"[-+]?[0-9]++\Z")
DECIMAL = re.compile(r"[-+]?(?:\.[0-9]++|[0-9]++(?:\.[0-9]*+)?)(?:[eE][-+]?[0-9]++)?\Z")
# Text that libyaml and PyYAML's own parser read differently: tabs, other line ends, marks of the
# byte order, directives, tags, "?" in texts, heads of text blocks.
PARSED_DIFFERENTLY = re.compile("[\t\r\x85\u2028\u2029\ufeff?!]|^%|[|>][-+0-9]*#", re.MULTILINE)
# Messages of the parser and their replacements in plain words; `begun` is the number of the line in
# which the wrong construct begins.
PLAIN = {
    re.compile(r"unexpected end of stream"): "the quote that begins in line {begun} does not end",
    re.compile(r"'\\t' that cannot start"): "this line is indented by a tab: use blanks",
    re.compile(r"'(.)' that cannot start"): "a text that begins with {0} needs quotes",
    re.compile(
        r"<block end>, but found '<block"
    ): "this line is not indented like the lines around it",
    re.compile(r"<block end>, but found '(.+)'"): "{0} is not allowed here",
    re.compile(
        r"expected ',' or '(.)', but got"
    ): "the bracket of line {begun} needs a {0} before this",
    re.compile(r"mapping values are not allowed"): (
        "this colon is wrong: the line is indented too far, or a text with a colon needs quotes"
    ),
    re.compile(r"could not find expected ':'"): "line {begun} has no colon after its key",
}
ENDLESS = re.compile(r"(?:[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))\Z")


class Loader(yaml.SafeLoader):
    """Safe loader that rejects repeated keys and aliases that multiply the size of a document."""

    def get_single_data(self) -> Any:
        """Construct the document after a check of the number of aliased values."""
        node = self.get_single_node()
        if node is None:
            return None
        _check_aliases(node)
        return self.construct_document(node)

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Compose a mapping; its keys must differ before merged keys are added."""
        node = super().compose_mapping_node(anchor)
        keys = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.tag == BOOL:
                    # Keys such as off are text.
                    key.tag = STR
                if (key.tag, key.value) in keys:
                    raise _node_error(key, f"the key {show(key.value)} is repeated")
                keys.add((key.tag, key.value))
        return node

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Insert merged keys first, so that explicit keys override them; PyYAML 6.0.4 does not."""
        merged, explicit = [], []
        for key, value in node.value:
            if key.tag != MERGE_TAG:
                explicit.append((key, value))
                continue
            # The first mapping of a list overrides the others.
            for part in reversed(value.value) if isinstance(value, yaml.SequenceNode) else [value]:
                if not isinstance(part, yaml.MappingNode):
                    raise _node_error(part, f"{MERGE} takes a mapping or a list of mappings")
                self.flatten_mapping(part)
                merged += part.value
        node.value = merged + explicit


class QuickLoader(Loader):
    """`Loader` with the parser of libyaml, which makes it six times as fast."""

    def __init__(self, stream: str) -> None:
        yaml.composer.Composer.__init__(self)
        yaml.constructor.SafeConstructor.__init__(self)
        yaml.resolver.Resolver.__init__(self)
        # Some builds of PyYAML lack this module.
        from yaml._yaml import CParser

        parser = CParser(stream)
        for name in ("check_event", "get_event", "peek_event"):
            setattr(self, name, getattr(parser, name))


def construct_int(loader: Loader, node: yaml.ScalarNode) -> int:
    """Integer in decimal digits; 1_000, 1:30 and 010 are rejected."""
    text = str(loader.construct_scalar(node))
    if not WHOLE.match(text):
        raise _node_error(node, f"{show(text)} is not a whole number")
    # `_parse` rejects numbers with thousands of digits.
    _parse(text, node)
    return int(text)


def construct_float(loader: Loader, node: yaml.ScalarNode) -> float:
    """Decimal number, infinity or NaN; the later check of the key may reject infinity or NaN."""
    text = str(loader.construct_scalar(node))
    if ENDLESS.match(text):
        return float(text.replace(".", ""))
    return _parse(text, node)


def _parse(text: str, node: yaml.Node) -> float:
    """Parse a number; raises an error that states the line."""
    if len(text) > LONGEST:
        raise _node_error(node, f"{show(text)} has {len(text)} characters, too many for a number")
    try:
        return parse_number(text)
    except ValueError:
        raise _node_error(node, f"{show(text)} is not a finite number") from None


def _node_error(node: yaml.Node, problem: str) -> yaml.constructor.ConstructorError:
    """Error at the position of a node."""
    return yaml.constructor.ConstructorError(None, None, problem, node.start_mark)


# PyYAML reads numbers as in YAML 1.1, and dates and "="; these must stay text in a title.
Loader.yaml_implicit_resolvers = {
    first: [x for x in resolvers if x[0] not in (FLOAT, INT, TIMESTAMP, VALUE)]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
Loader.add_implicit_resolver(INT, WHOLE, list("-+0123456789"))
Loader.add_implicit_resolver(FLOAT, DECIMAL, list("-+.0123456789"))
Loader.add_implicit_resolver(FLOAT, ENDLESS, list("-+."))
Loader.add_constructor(INT, construct_int)
Loader.add_constructor(FLOAT, construct_float)


class AngleLoader(Loader):
    """Loader with the tags for angles in robot files, which are converted to radians."""


def construct_degrees(loader: Loader, node: yaml.Node) -> float:
    """Convert an angle in degrees to radians."""
    return math.radians(_parse(str(node.value), node))


def construct_radians(loader: Loader, node: yaml.Node) -> float:
    """Read an angle in radians."""
    return _parse(str(node.value), node)


AngleLoader.add_constructor("!degrees", construct_degrees)
AngleLoader.add_constructor("!radians", construct_radians)


def load(content: str | bytes, source: str, loader: type[Loader] = Loader) -> Any:
    """Load the YAML document in a text, or in bytes of UTF-8."""
    with _reading(content, source):
        text = content if isinstance(content, str) else content.decode("utf-8")
        # These two classes differ only by tags, which PARSED_DIFFERENTLY excludes.
        plain = loader in (Loader, AngleLoader) and not PARSED_DIFFERENTLY.search(text)
        if plain and yaml.__with_libyaml__:
            # After an error, PyYAML's own parser reads the text again for the message.
            with suppress(yaml.YAMLError, ValueError, TypeError, OverflowError, RecursionError):
                return yaml.load(text, Loader=QuickLoader)
        return yaml.load(text, Loader=loader)


def load_with_node(text: str, source: str) -> tuple[Any, yaml.Node | None]:
    """Load a YAML document; also returns its root node, with line numbers, or None if empty."""
    # In the nodes, merged keys stay where they are written.
    with _reading(text, source):
        loader = Loader(text)
        node = loader.get_single_node()
        if node is None:
            return None, None
        _check_aliases(node)
        # Merging moves nodes, so a text with a merge key is composed again.
        root = yaml.compose(text, Loader=Loader) if MERGE in text else node
        return loader.construct_document(node), root


@contextmanager
def _reading(content: str | bytes, source: str) -> Iterator[None]:
    """Context that converts errors of parsing to InvalidInput."""
    if len(content) > MAX_CHARACTERS:
        raise InvalidInput(
            f"{source} has {len(content) / 1e6:.0f} million characters, more than the "
            f"limit of {MAX_CHARACTERS / 1e6:.0f} million for YAML. Write a long path to a "
            "separate CSV file."
        )
    try:
        yield
    except UnicodeDecodeError as error:
        raise InvalidInput(
            f"{source} is not valid YAML: it is not text in UTF-8 ({error})."
        ) from None
    except RecursionError:
        raise InvalidInput(f"{source} is not valid YAML: it is nested too deeply.") from None
    except yaml.YAMLError as error:
        raise InvalidInput(f"{source} is not valid YAML: {_describe_error(error)}.") from None
    except (ValueError, TypeError, OverflowError) as error:
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput(f"{source} is not valid YAML: {error}.") from None


def _check_aliases(root: yaml.Node) -> None:
    """Check the number of values that aliases add, and that no anchor contains its own alias."""
    sizes: dict[int, int] = {}
    inside: set[int] = set()
    written = 0

    def size(node: yaml.Node) -> int:
        nonlocal written
        if id(node) in inside:
            raise _node_error(node, "an alias is inside its own anchor")
        if id(node) not in sizes:
            count = 1
            if isinstance(node, yaml.ScalarNode):
                count += len(node.value) // CHARACTERS_PER_VALUE
            written += count
            inside.add(id(node))
            sizes[id(node)] = count + sum(map(size, _parts(node)))
            inside.discard(id(node))
        return sizes[id(node)]

    aliased = size(root) - written
    if aliased > MAX_ALIASED:
        raise _node_error(
            root,
            f"its aliases add more than {MAX_ALIASED} values: use fewer aliases",
        )


def _parts(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [x for pair in node.value for x in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def _describe_error(error: yaml.YAMLError) -> str:
    """Problem, line and column of an error."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        mark, begun = error.problem_mark, error.context_mark or error.problem_mark
        problem = error.problem or ""
        for pattern, words in PLAIN.items():
            if (match := pattern.search(problem)) is not None:
                problem = words.format(*match.groups(), begun=begun.line + 1)
                break
        return f"{problem} (line {mark.line + 1}, column {mark.column + 1})"
    return " ".join(str(error).split())
