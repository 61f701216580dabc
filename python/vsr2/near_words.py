"""Words that a mistyped one most likely means."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import takewhile


@dataclass(frozen=True)
class NearWords:
    """How alike a word is that may be meant, by difflib's share of equal letters; by hand.

    Attributes:
        alike: of one word that is named as meant.
        slip: where a word that is no slip is as likely: names of files, effects of other libraries.
        offered: of several words that are offered, and of one that begins with the same letter.
        fewest: letters of words that may be one letter off; `gear` is no slip of `wear`.
        longest: letters of a word that are looked at; the search is quadratic in them.
    """

    alike: float = 0.75
    slip: float = 0.8
    offered: float = 0.6
    fewest: int = 5
    longest: int = 255


NEAR = NearWords()
_LARGEST = re.compile("^(maximum|max|largest|greatest)")
"""What a word begins with that means what begins with `peak` here."""


def near_words(
    word: str, known: Iterable[str], *, most: int = 1, alike: float = NEAR.alike
) -> list[str]:
    """At most so many of the known words that are alike, the nearest first."""
    return difflib.get_close_matches(word[: NEAR.longest], known, n=most, cutoff=alike)


def slip_of(word: str, known: Iterable[str]) -> str | None:
    """The known word of which a word is a slip; None: it may be another's own word.

    A slip is spelt in other capitals or with other hyphens, is one letter off, or very alike.
    """
    plain = {_plain(one): one for one in known}
    own = _plain(word[: NEAR.longest])
    near = [own] if own in plain else [one for one in plain if _is_one_off(own, one)]
    near = near or near_words(own, plain, alike=NEAR.slip)
    return plain[near[0]] if near else None


def _plain(word: str) -> str:
    return word.replace("_", "").replace("-", "").casefold()


def _is_one_off(one: str, other: str) -> bool:
    """Whether two letters are swapped, or in longer words one is wrong, too many or missing."""
    pairs = zip(one, other, strict=False)
    alike = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
    mine, theirs = one[alike:], other[alike:]
    if len(mine) > 1 and mine[:2] == theirs[1::-1] and mine[2:] == theirs[2:]:
        return True
    long = min(len(one), len(other)) >= NEAR.fewest
    return long and (theirs[1:] in (mine[1:], mine) or mine[1:] == theirs)


def peak(word: str) -> str:
    """A word that begins with `max`, `largest` or the like, begun as here."""
    return _LARGEST.sub("peak", word)


def nearest(word: str, choices: Iterable[str]) -> str | None:
    """The choice that `word` most likely means; camelCase (as in ROS 2 files) is understood."""
    plain = {choice.replace("_", "").lower(): choice for choice in choices}
    word = word[: NEAR.longest].replace("_", "").lower()
    # `max_tilt_rad` is nearer to `tilt_rad`, a series, than to the largest tilt that it means.
    near = near_words(peak(word), plain) or near_words(word, plain)
    # A shorter word says less by its share of equal letters; its start and end say more.
    near = near or [name for name in plain if len(word) > 2 and name.startswith(word)]
    near = near or [
        name for name in near_words(word, plain, most=3, alike=NEAR.offered) if name[0] == word[0]
    ]
    return plain[near[0]] if near else None


def offer(word: str, known: Sequence[str]) -> str:
    """A remedy that names what `word` was probably meant to be."""
    close = near_words(word, known, most=3, alike=NEAR.offered)
    if close:
        return f"did you mean {' or '.join(f'`{name}`' for name in close)}?"
    return f"known are {', '.join(sorted(known))}"
