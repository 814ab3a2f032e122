"""What a check says: a mistake or a remark, where it is, and what to do about it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from importlib.resources import files
from typing import Any, Literal

from daq.messages import Sentence

#: Text and cure by key: a code, or ``code/variant``. Values stand in braces, as for ``str.format``.
TEXTS: dict[str, tuple[str, str]] = json.loads(files(__package__).joinpath("texts.json").read_text("utf-8"))
#: `mistake`: more likely than any effect of the catalogue. `note`: said, but harmless.
Severity = Literal["mistake", "note"]


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, or worth saying.

    Attributes
    ----------
    code : what it is, as in ``docs/checks.md``
    text : what was seen, one sentence
    cure : what to do, one sentence
    joint, channel : where; None where it is not of one
    recording : file that it was seen in; None where it was in all
    severity : ``mistake`` or ``note``
    before, after : misfit (or another number that the text names) as the files are, and with the cure
    unit : of both
    factor : number that was interpreted (a gain, an offset, a delay), if there is one
    says : unit that values look like, where another was declared
    channels : all that it is about, where they are several
    alternatives : what explains the data as well, and cannot be told apart by them
    strength : for the order of findings: natural logarithm of how much better the data fit with the cure
    """

    code: str
    text: str
    cure: str
    joint: str | None = None
    channel: str | None = None
    recording: str | None = None
    severity: Severity = "mistake"
    before: float | None = None
    after: float | None = None
    unit: str = ""
    factor: float | None = None
    says: str | None = None
    channels: tuple[str, ...] = ()
    alternatives: tuple[str, ...] = ()
    strength: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """Return plain content."""
        return asdict(self)

    @property
    def line(self) -> str:
        """What was seen and what to do, in one line."""
        others = Sentence("fitting.as_well", alternatives="; ".join(self.alternatives)) if self.alternatives else ""
        return f"{self.text}{others}; {self.cure}"


_LEFT_OPEN = {"channel": "{channel}", "joint": "{joint}"}
#: What of the values in its texts a finding has as well.
_OWN = frozenset({"joint", "channel", "recording", "before", "after", "unit", "factor", "says"})


def finding_of(
    key: str,
    *,
    severity: Severity = "mistake",
    alternatives: tuple[str, ...] = (),
    strength: float = 0.0,
    **values: Any,
) -> Finding:
    """Make a finding by the key of its texts; ``values`` fill them, or are the finding's own fields, or both."""
    own = {name: value for name, value in values.items() if name in _OWN}
    texts = worded(key, **values)
    return Finding(*texts, severity=severity, alternatives=alternatives, strength=strength, **own)


def worded(key: str, **values: Any) -> tuple[str, str, str]:
    """Return code, text and cure by key; a channel or joint without a value is left open (``{channel}``)."""
    text, cure = (text.format(**_LEFT_OPEN | values) for text in TEXTS[key])
    return key.partition("/")[0], text, cure
