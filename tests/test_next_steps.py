"""Each message for the user gives a next step: an action, a command, or the possible choices."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("teleop_rt", "drivers/teleop_rt_drivers", "teleop_rt_dev")
PROBLEM = "ConfigProblem"
"""Its second argument is a message, too: a ConfigError consists of such problems."""

ACTIONS = """add calibrate change check choose clear close connect copy correct cut describe end
    export find get give invert join keep leave let list look lower make move name open press put
    raise read record release remove repeat replay return run say see set start state stop switch
    take turn try use wait write"""
CHOICES = "one of|it has|there are|expected|needed|at most|roles"
FORWARDED = "step|next|hint|meant|advice|error|problem|message|said"
STEP = re.compile(
    rf"(?:^|[:;,?(] |\b(?:or|and|then) )(?:{'|'.join(ACTIONS.split())})\b"
    rf"|\b(?:{CHOICES})\b|`|[:;] \{{[^}}]*(?:{FORWARDED})[^}}]*\}}(?:$|; )|\{{(?:next_step|hint)\}}"
)
"""A clause that begins with an action; the possible values or their bounds; a command in backticks;
or a part at the end that another message or table gives, which has a step of its own."""
OF_A_CALLER = {
    "no answer": "`upload` gives the cause alone; the survey that calls it adds the step",
    "{error}; {_IN_PYTHON[function]}": "the error has a step; the table adds its name in Python",
}
"""Messages without a step, and why."""


@cache
def trees():
    """Return the syntax tree of each module that raises, defines or reports an error of ours."""
    texts = {
        path: path.read_text(encoding="utf-8")
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
    }
    return {
        path: ast.parse(text)
        for path, text in texts.items()
        if re.search(rf"Error\(|\(.*Error\)|{PROBLEM}", text)
    }


@cache
def expected_errors():
    """Return the names of ExpectedError and of all classes below it."""
    bases = {
        node.name: {ast.unparse(base).rpartition(".")[2] for base in node.bases}
        for tree in trees().values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }
    found, before = {"ExpectedError"}, set()
    while found != before:
        before, found = found, found | {name for name, of in bases.items() if of & found}
    return found


def strings(tree):
    """Return the strings assigned to each name of a module, in functions as well."""
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            found.setdefault(node.targets[0].id, []).append(node.value)
    return found


def text_of(node, assigned):
    """Return the fixed text of a message, with the words of its parts; None of a forwarded one."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.Name) and node.id in assigned:
        texts = [text_of(value, {}) for value in assigned[node.id]]
        return None if None in texts else " | ".join(texts)
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(part, assigned) or "" for part in node.values)
    if isinstance(node, ast.FormattedValue):
        return text_of(node.value, assigned) or f"{{{ast.unparse(node.value)}}}"
    return None


def messages():
    """Return (place, fixed text) of each message that is written where it is raised."""
    found = []
    for path, tree in trees().items():
        assigned = strings(tree)
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call):
                continue
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            if name == PROBLEM and len(node.args) > 1:
                text = text_of(node.args[1], assigned)
            elif name in expected_errors() and node.args:
                text = text_of(node.args[0], assigned)
            else:
                continue
            if text is not None:
                found.append((f"{path.relative_to(ROOT)}:{node.lineno}", text))
    return found


def without_step(found):
    """Return those of the (place, text) that leave the user without a next step."""
    return [one for one in found if not STEP.search(one[1]) and one[1] not in OF_A_CALLER]


@pytest.mark.parametrize(
    "text",
    [
        "link.key: not a key",
        "--lever-m is only for a rotary rig",
        "{path}: no such file",
        "is it free?",
    ],
)
def test_a_cause_alone_is_found(text):
    """A pattern that every text matches would keep nothing."""
    assert without_step([("here", text)])


def test_each_message_for_the_user_gives_a_next_step():
    found = messages()
    assert len(found) > 300, "the messages are found"
    bad = without_step(found)
    assert not bad, "\n".join(f"{place}: add the next step: {text}" for place, text in bad)


def test_no_exception_is_left_over():
    assert set(OF_A_CALLER) <= {text for _, text in messages()}
