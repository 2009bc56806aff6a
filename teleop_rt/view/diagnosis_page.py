"""A page for one diagnosis: verdict, residual before and after, candidates (extra `report`).

It shows the answer, as `teleop-rt diagnose --json` prints it, and the rows of its residuals.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

from teleop_rt.contact.effect import handling_in_words
from teleop_rt.diagnosis.answers import extended
from teleop_rt.diagnosis.answers.errors import predicts_worse
from teleop_rt.diagnosis.answers.residuals import Residuals
from teleop_rt.diagnosis.criteria import HIGHEST_BESIDE_UNKNOWN
from teleop_rt.metrics import in_percent
from teleop_rt.view import style
from teleop_rt.view.html import Tile, figures_of, render
from teleop_rt.view.plots import svg
from teleop_rt.view.quantities import size_seen
from teleop_rt.view.residual_charts import residual_charts
from teleop_rt.view.residual_figure import residual_figure

_CERTAIN_BIC = 14.0  # odds of a thousand to one for one effect (Kass and Raftery 1995)
_LARGE_GAIN = 1e5  # from which a gain is given by its power of ten
_BESIDE = "outliers"  # found beside the candidates, so they are in no row
_VERDICTS = {
    "no_missing_effect": ("good", "Nothing is missing: the base explains the force to the noise."),
    "named": ("good", "Named: {names}."),
    "doubted": ("attention", "Named: {names}; the probability and the notes say why to doubt it."),
    "class": (
        "attention",
        "Not decided: {names}. These data cannot distinguish them{proposal}.",
    ),
    "partial": (
        "attention",
        "Partly named: {names}; something is left that no declared effect explains.",
    ),
    "unexplained": (
        "attention",
        "Something is left that no declared effect explains{family}.",
    ),
}


def write(answer: dict[str, Any], residuals: Residuals, folder: Path) -> list[Path]:
    """Write diagnosis.html, model.yaml, and residual.png, .svg and .pdf; returns their paths.

    `folder` is made if it is not there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = ("diagnosis.html", "residual.png", "residual.svg", "model.yaml", "residual.pdf")
    paths = [folder / name for name in names]
    figure = residual_figure(residuals)
    figure.savefig(paths[1], dpi=110)
    drawn = svg(figure, "residual before and after")
    paths[2].write_text(f'<?xml version="1.0" encoding="utf-8"?>\n{drawn}', encoding="utf-8")
    extended.write(paths[3], answer)
    figure.savefig(paths[4], metadata={"CreationDate": None})
    grade, verdict = _verdict(answer)
    page = render(
        "diagnosis.html.j2",
        answer=answer,
        grade=grade,
        verdict=verdict,
        sentences=sentences(answer),
        tiles=list(_tiles(answer)),
        written_at=datetime.now().astimezone().isoformat(timespec="seconds"),
        candidates=_candidates(answer),
        certain=f"{_CERTAIN_BIC:g}",
        parameters=list(_parameters(answer)),
        size_seen=size_seen,
        **figures_of(residual_charts(residuals)),
    )
    paths[0].write_text(page, encoding="utf-8")
    return paths


def sentences(answer: dict[str, Any]) -> list[str]:
    """Return the answer in words and figures: each effect, the next motion, the notes."""
    lines = [_effect(entry, answer["verdict"]) for entry in answer["effects"]]
    if answer["experiment"]:
        lines.append(f"The motion that would decide: {answer['experiment']['why']}.")
    lines += list(_beyond_the_vocabulary(answer))
    lines += [f"Note: {note}." for note in answer["notes"]]
    return lines


def _effect(entry: dict[str, Any], verdict: str) -> str:
    """Return the sentence of an effect with its figures, and the controller's handling of it."""
    undecided = f"If it is {_names([entry['name']])}: " if verdict == "class" else ""
    handling = handling_in_words(entry["compensation"])
    belongs = f"It belongs to the {entry['belongs_to']}; on-line: {handling}."
    return f"{undecided}{style.effect_in_words(entry)} {belongs}"


def _beyond_the_vocabulary(answer: dict[str, Any]) -> Iterator[str]:
    """Yield the nearest effect, the variables of the rest, and the law drafted for it."""
    if (nearest := answer["nearest"]) is not None:
        before, after = _percent(nearest["before"]), _percent(nearest["after"])
        yield (
            f"Nearest is {_names(nearest['effects'])} ({nearest['family']}): it explains"
            f" {100.0 * nearest['share']:.0f} % of the base's residual, error {before} → {after}."
        )
    if answer["dependence"] is not None:
        parts = sorted(answer["dependence"].items(), key=lambda item: -item[1])
        shares = ", ".join(f"{group} {100.0 * share:.0f} %" for group, share in parts if share > 0)
        yield f"What is left depends on {shares}."
    if (draft := answer["draft"]) is not None:
        before, after = (_percent(draft["error"][key]) for key in ("before", "after"))
        worse = ", worse than the set of effects above" if predicts_worse(answer) else ""
        yield (
            f"A law was drafted from it, of {'; '.join(draft['terms'])}: error on"
            f" {draft['error']['on']} {before} → {after}{worse}. draft_effect.py beside this page"
            " declares it for --effects: give it a name."
        )


def _verdict(answer: dict[str, Any]) -> tuple[str, str]:
    grade, text = _VERDICTS["doubted" if _is_doubted(answer) else answer["verdict"]]
    # The first set in the order of its effects below, and of the text.
    sets = [[entry["name"] for entry in answer["effects"]], *answer["class"][1:]]
    names = " or ".join(_names(one) for one in sets)
    proposal = (
        "; the motion that would is in motion.csv beside this page" if answer["experiment"] else ""
    )
    family = f" (nearest family: {answer['family']})" if answer["family"] else ""
    return grade, text.format(names=names, proposal=proposal, family=family)


def _is_doubted(answer: dict[str, Any]) -> bool:
    """Return whether a named set is as unsure as beside an unknown remainder, or does not predict.

    A residual that is no noise bounds the probability to that.
    """
    if answer["verdict"] != "named":
        return False
    least = min(answer["probability"].values(), default=1.0)
    before, after = (answer["error"][key] for key in ("before", "after"))
    return least <= HIGHEST_BESIDE_UNKNOWN or after is None or after > (before or after)


def _names(effects: list[str] | tuple[str, ...]) -> str:
    return " and ".join(name.replace("_", " ") for name in effects)


def _tiles(answer: dict[str, Any]) -> Iterator[Tile]:
    """Give the answers of the first screen: error, base, and each effect."""
    error = answer["error"]
    before, after, floor = (error.get(key) for key in ("before", "after", "noise_floor"))
    parts = [_percent(before)]
    parts += [_percent(after)] if answer["effects"] else []
    noise = f"the noise alone: {_percent(floor)}"
    if answer["verdict"] in {"partial", "unexplained"}:
        noise = f"the noise alone: at most {_percent(floor)}; more of the rest may hide in it"
    details = (f"NRMSE on {error.get('on')}, in free run", noise)
    title = "Error before → after" if answer["effects"] else "Error of the base"
    yield Tile(title, "unknown", " → ".join(parts), details)
    base = answer["base"]
    figures = tuple(style.parameter(name, p) for name, p in base["parameters"].items())
    yield Tile("Base", "unknown", style.model_name(base["model"]), figures)
    for entry in answer["effects"]:
        figures = tuple(_in_words(name, p) for name, p in entry["parameters"].items())
        if entry["explains"] is not None:
            figures += (f"explains {in_percent(entry['explains'], 3)} of the base's residual",)
        if (chance := answer["probability"].get(entry["name"])) is not None:
            figures += (f"probability {chance:.2f}",)
        title = "Effect" if answer["verdict"] != "class" else "First of the class"
        yield Tile(title, "unknown", _names([entry["name"]]), figures)


def _percent(value: float | None) -> str:
    return "–" if value is None else in_percent(value)


def _in_words(name: str, content: dict[str, Any]) -> str:
    return style.parameter(name.replace("_", " "), content)


def _parameters(answer: dict[str, Any]) -> Iterator[dict[str, str]]:
    base = answer["base"]
    for name, content in base["parameters"].items():
        yield {"of": style.model_name(base["model"]), "text": style.parameter(name, content)}
    for entry in answer["effects"]:
        for name, content in entry["parameters"].items():
            yield {"of": _names([entry["name"]]), "text": _in_words(name, content)}


def _gain(value: float) -> str:
    """Return a gain to three digits: more are noise, and hide the order of size."""
    if abs(value) >= _LARGE_GAIN:
        digits, exponent = f"{value:.2e}".split("e")
        text = f"{digits} × {style.printed(f'10^{int(exponent)}')}"
    else:
        text = f"{float(f'{value:.3g}'):,.0f}".replace(",", " ")
    return text.replace("-", "−")


def _named(effect: str, law: str) -> str:
    """Return an effect with its law: two candidates may differ in that alone."""
    name = effect.replace("_", " ")
    return f"{name} ({law})" if law else name


def _candidates(answer: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the rows of the table of candidates; those of the answer are marked."""
    sets = answer["class"] or [[entry["name"] for entry in answer["effects"]]]
    chosen = {frozenset(one) - {_BESIDE} for one in sets}
    return [
        {
            "names": " + ".join(map(_named, one["effects"], one["laws"])),
            "belongs_to": ", ".join(one["belongs_to"]),
            "bic": _gain(one["delta_bic"]),
            "explains": round(100.0 * one["explains"], 1),
            "chosen": frozenset(one["effects"]) in chosen,
        }
        for one in answer["candidates"]
    ]
