"""Worn words: cleaned packages hold none, and the count of every other package may only fall."""

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
READ = {"", ".py", ".md", ".yaml", ".service", ".rules"}

WORN = {
    "tell told": (
        r"(?<![a-z.])(tells?|told|telling)(?![a-z]|\(self\))",
        "report, return, detect or distinguish",
    ),
    "what": (
        r"(?:\"\"\"|[.;] |\n *)(?-i:Whats?) ",
        "put the subject first: 'The values of a sample', not 'What a sample holds'",
    ),
    " what": (
        r"(?-i:(?<=[a-z,;:]) what(?= [a-z])(?! (?:to (?:do|write)|in|for|if|else)\b))",
        "name the thing: 'the residual of the fit', not 'what the fit leaves'",
    ),
    "borne bear": (r"\b(borne|bears?|bearing)[ _]out\b", "confirmed by"),
    "look": (r"\blook(s|ed|ing)? for\b", "search, find, expect"),
    "by": (r"\bgo(es)? by\b", "use, follow, depend on"),
    "stand": (r"\bstand(s|ing)? for\b", "represent, mean, replace"),
    "say": (r"\bsays? (of|nothing of)\b", "report that, state"),
    "hollow": (
        r"\bhollow\b",
        "name the property: its parameters do not show what its name says",
    ),
    "anew afresh": (r"\b(anew|afresh)\b", "again, new"),
    "none": (r"\b(that|which) (is|are) none\b", "not a number"),
    "session": (
        r"\bsession(_folder| folder|: Path)\b",
        "'ring folder': a session is an authenticated connection of the link",
    ),
    "want reckon word": (
        r"\b(for want of|reckon\w*|no word of|without a word)\b",
        "archaic",
    ),
}
"""Stems, one of which every match holds; a pattern (case ignored); what to write instead."""

PLACES = [
    *("CHANGELOG.md", "CONTRIBUTING.md", "README.md", "SECURITY.md", "config", "docs", "drivers"),
    *("scripts", "teleop_rt_dev", "teleop_rt/*.py", "teleop_rt/*/", "tests/*.py", "tests/*/"),
]
NOT_YET = {
    "tests/view": 1,
}
"""Worn words in places that nobody has rewritten yet. Lower a number; never raise or add one."""


@cache
def places():
    """Return every place by its name: a file, a folder with all below, or the files of a folder."""
    return {
        pattern if pattern.endswith(".py") else path.relative_to(ROOT).as_posix(): (
            sorted(ROOT.glob(pattern)) if pattern.endswith(".py") else [path]
        )
        for pattern in PLACES
        for path in ROOT.glob(pattern)
        if path.name != "__pycache__" and not path.is_symlink()
    }


def texts(paths):
    """Return (path, text) of each file that people write; generated JSON is not read."""
    files = [f for path in paths for f in (path.rglob("*") if path.is_dir() else [path])]
    return [
        (file, file.read_text(encoding="utf-8"))
        for file in sorted(files)
        if file.suffix in READ and file.is_file() and file != Path(__file__)
    ]


def worn(text):
    """Return (line number, word, what to write instead) of each worn word of a text.

    The stems are sought first, because most files hold none and a regular expression is slow.
    """
    small = text.lower()
    return [
        (text.count("\n", 0, match.start()) + 1, match.group(), instead)
        for stems, (pattern, instead) in WORN.items()
        if any(stem in small for stem in stems.split())
        for match in re.finditer(pattern, text, re.IGNORECASE)
    ]


@pytest.mark.parametrize(
    "sentence",
    [
        *(
            "Tell whether the residual is white.",
            "def test_it_is_told(): ...",
            '"""What a tick costs.',
            "It is read. What follows is not.",
            "it is read.\n    What follows is not",
            "the share of what the base leaves",
        ),
        *(
            "a fit that noise bears out",
            "The surface is looked for.",
            "it goes by name",
            "no word of it",
        ),
        *(
            "x stands for a force",
            "says nothing of it",
            "a hollow effect",
            "begun anew",
            "the session folder",
            "which is none",
        ),
    ],
)
def test_each_worn_word_is_found(sentence):
    """A pattern that finds nothing would let every text pass."""
    assert len(worn(sentence)) == 1


@pytest.mark.parametrize(
    "sentence",
    [
        "Return whether the residual is white.",
        "an intellectual",
        "A shell and a hotel.",
        "stands forth",
        "the cause, then what to do",
        "[what for what in said if what]",
    ],
)
def test_plain_sentences_pass(sentence):
    """Words that only contain a worn one are plain."""
    assert worn(sentence) == []


@pytest.mark.parametrize("name", places())
def test_no_text_has_more_worn_words_than_before(name):
    """Cleaned places have none; the failure names file, line, word and what to write instead."""
    found = [
        f"{file.relative_to(ROOT)}:{line}: {word!r}: {instead}"
        for file, text in texts(places()[name])
        for line, word, instead in worn(text)
    ]
    assert len(found) <= NOT_YET.get(name, 0), "\n".join(found)


def test_the_list_of_places_names_no_other():
    """A place that was renamed takes its number along; a number of nothing is removed."""
    assert set(NOT_YET) <= set(places())
