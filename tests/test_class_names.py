"""A class name of the product has one meaning: no two modules define it."""

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]
PRODUCT = ("teleop_rt", "drivers/teleop_rt_drivers")
SHARED = {"Diagnosis": "of teleop_rt itself: it presents that of diagnosis/inference to a user"}
"""Names that two modules may define, each with its reason."""


def defined_twice(modules: dict[str, str]) -> dict[str, list[str]]:
    """Return the public classes that several of these modules (path: text) define, by name.

    Classes of keys are left out: each is named as in the JSON that the documentation shows.
    """
    found = defaultdict(list)
    for path, text in modules.items():
        if path.endswith("_keys.py"):
            continue
        for node in ast.parse(text).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found[node.name].append(path)
    return {name: paths for name, paths in found.items() if len(paths) > 1}


def test_a_class_of_two_modules_is_found():
    modules = {"a.py": "class Port: ...", "b.py": "class Port: ...\nclass _Port: ..."}
    assert defined_twice(modules) == {"Port": ["a.py", "b.py"]}
    assert not defined_twice({"a.py": "class Port: ...", "answer_keys.py": "class Port: ..."})


def test_each_class_name_of_the_product_is_defined_once():
    modules = {
        path.relative_to(ROOT).as_posix(): path.read_text()
        for folder in PRODUCT
        for path in sorted((ROOT / folder).rglob("*.py"))
    }
    found = defined_twice(modules)
    assert found.keys() == SHARED.keys(), found
