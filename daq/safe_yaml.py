"""YAML as far as our files need it, from anybody: bounded in size, depth and aliases, and with plain values only.

PyYAML's safe loader makes no objects of other programs, but it can still be made to work without end: aliases of
aliases are unfolded by whoever walks the result ("billion laughs"), merges copy what they merge, and YAML 1.1 reads
``1:00:00`` as a number to the base 60, in quadratic time. Here a text costs no more than its budget, whatever it says.
"""

from __future__ import annotations

import re
from functools import partial
from typing import Any

import yaml

from daq.messages import Sentence

#: Values, keys, lists and mappings of a text, each alias counted as all that it stands for. A machine file of six
#: joints with every channel and its source has about 1 300; one takes 6 us with libyaml, 30 us without.
MOST_NODES = 20_000
#: Lists and mappings within each other; a machine file has seven.
DEEPEST = 32
#: Digits of one number; the longest that a machine file can mean is a double, 24.
LONGEST_NUMBER = 64
_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_TAGS = frozenset(f"tag:yaml.org,2002:{kind}" for kind in ("null", "bool", "int", "float", "str", "seq", "map"))
_yaml: Any = yaml  # whose stubs lack what is named below
#: What cuts a text into events: libyaml, in a quarter of the time, where PyYAML was built with it.
_EVENTS: tuple[Any, ...] = (
    (_yaml.cyaml.CParser,)
    if yaml.__with_libyaml__
    else (_yaml.reader.Reader, _yaml.scanner.Scanner, _yaml.parser.Parser)
)


class _Loader(yaml.composer.Composer, *_EVENTS, yaml.constructor.SafeConstructor, yaml.resolver.Resolver):  # type: ignore[misc]
    """The safe loader within its budget; dates and numbers to the base 60 are text, sets and binary data errors.

    Nodes are composed here and not by libyaml, so that they are counted before they are made.
    """

    # What looks like a date stays text; the numbers are those of YAML 1.1 without colons.
    yaml_implicit_resolvers = {  # noqa: RUF012 (the name and form are PyYAML's)
        first: [
            (tag, pattern)
            for tag, pattern in resolvers
            if tag in (*_TAGS, "tag:yaml.org,2002:merge") and tag not in _NUMBERS
        ]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def __init__(self, text: str) -> None:
        reader, *rest = _EVENTS
        reader.__init__(self, text)
        for part in (*rest, _yaml.composer.Composer, _yaml.constructor.SafeConstructor, _yaml.resolver.Resolver):
            part.__init__(self)
        self._nodes = 0
        self._depth = 0
        self._sizes: dict[int, int] = {}

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Compose the next node, counted."""
        event = self.peek_event()
        mark = event.start_mark
        if isinstance(event, yaml.AliasEvent):
            found = self.anchors.get(event.anchor)
            # A list that is not whole yet has no size: it would hold itself.
            if found is not None and id(found) not in self._sizes:
                raise yaml.composer.ComposerError(None, None, Sentence("daq.alias_stands_part"), mark)
            self._count(0 if found is None else self._sizes[id(found)], mark)
            return super().compose_node(parent, index)
        before = self._nodes
        self._count(1, mark)
        self._depth += 1
        if self._depth > DEEPEST:
            raise yaml.composer.ComposerError(None, None, Sentence("daq.nested_more_deep", deepest=DEEPEST), mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        if node is not None:
            if node.tag not in _TAGS and node.tag != "tag:yaml.org,2002:merge":
                raise yaml.composer.ComposerError(
                    None, None, Sentence("daq.values_kind_not_read", tag=node.tag[-40:]), mark
                )
            self._sizes[id(node)] = self._nodes - before
        return node

    def _count(self, nodes: int, mark: yaml.Mark) -> None:
        self._nodes += nodes
        if self._nodes > MOST_NODES:
            text = Sentence("daq.more_values_aliases_counted", most_nodes=MOST_NODES)
            raise yaml.composer.ComposerError(None, None, text, mark)

    def construct_number(self, node: yaml.Node, read: Any) -> Any:
        """Parse a number of bounded length; Python takes quadratic time for long ones, and cannot print them."""
        text = self.construct_scalar(node)  # type: ignore[arg-type]
        if len(text) > LONGEST_NUMBER or ":" in text:
            raise yaml.constructor.ConstructorError(None, None, Sentence("daq.no_number_can_read"), node.start_mark)
        try:
            return read(self, node)
        except ValueError:
            raise yaml.constructor.ConstructorError(
                None, None, Sentence("daq.no_number_can_read"), node.start_mark
            ) from None


_INTEGER = r"[-+]?0b[01_]+|[-+]?0[0-7_]+|[-+]?(?:0|[1-9][0-9_]*)|[-+]?0x[0-9a-fA-F_]+"
_REAL = (
    r"[-+]?(?:[0-9][0-9_]*)\.[0-9_]*(?:[eE][-+][0-9]+)?|\.[0-9][0-9_]*(?:[eE][-+][0-9]+)?"
    r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)"
)
_add: Any = _Loader.add_implicit_resolver
for _kind, _pattern, _first, _read in (
    ("float", _REAL, "-+0123456789.", yaml.SafeLoader.construct_yaml_float),
    ("int", _INTEGER, "-+0123456789", yaml.SafeLoader.construct_yaml_int),
):
    _add(f"tag:yaml.org,2002:{_kind}", re.compile(f"^(?:{_pattern})$"), list(_first))
    _Loader.add_constructor(f"tag:yaml.org,2002:{_kind}", partial(_Loader.construct_number, read=_read))


def read(text: str) -> tuple[yaml.Node | None, Any]:
    """Read the nodes of a YAML text, which know their lines, and its content.

    Parameters
    ----------
    text : one document

    Raises
    ------
    yaml.YAMLError
        If it is no YAML, or more than this reader takes; ``problem`` and ``problem_mark`` give what and where.
    """
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        return node, None if node is None else loader.construct_document(node)
    finally:
        loader.dispose()


def write(content: Any) -> str:
    """Write plain values as YAML text, keys in order; :func:`read` takes it back."""
    dumper = _yaml.CSafeDumper if yaml.__with_libyaml__ else yaml.SafeDumper
    return str(yaml.dump(content, Dumper=dumper, sort_keys=False, allow_unicode=True))
