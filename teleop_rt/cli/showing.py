"""The commands that show a run: its report, and the live page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from teleop_rt.cli.options import LivePort
from teleop_rt.errors import RecordingError


def report(
    folders: Annotated[list[Path], typer.Argument(help="run folder; two with --compare")],
    compare: Annotated[
        bool, typer.Option("--compare", help="set two runs side by side, on one page")
    ] = False,
    out: Annotated[Path | None, typer.Option("--out", help="the page of a comparison")] = None,
) -> None:
    """Write the report of a run from its folder, also of a run that ended badly."""
    try:
        from teleop_rt.view.commands import (  # noqa: PLC0415 - an extra may be absent
            compare_folders,
            report_of_folder,
        )
    except ImportError:
        raise RecordingError("no report: pip install 'teleop-rt[report]' adds it") from None
    if len(folders) != (2 if compare else 1):
        raise RecordingError("give one run folder, or two after --compare")
    if compare:
        print(compare_folders(folders, out, _rebuilt))
    else:
        print(report_of_folder(folders[0], _rebuilt))


def _rebuilt(folder: Path, slave: Mapping[str, Any]) -> dict[str, Any]:
    """Return the summary of a run that could not write its own."""
    from teleop_rt.cli.wiring import load_trial_file  # noqa: PLC0415 - loads compilers and drivers
    from teleop_rt.trial.folder import TRIAL  # noqa: PLC0415 - as above
    from teleop_rt.trial.rebuild import rebuilt_summary  # noqa: PLC0415 - as above
    from teleop_rt_drivers.simulated.reference import environment_force  # noqa: PLC0415 - as above

    trial = load_trial_file(folder / TRIAL, None)
    reference = environment_force if trial.plant is not None else None
    return rebuilt_summary(folder, trial, slave, reference)


def live(
    recording: Annotated[
        Path | None, typer.Argument(help="play back a recording or run folder, instead")
    ] = None,
    port: LivePort = 5006,
    host: Annotated[
        str, typer.Option(help="address to serve at; by default this machine alone may look")
    ] = "127.0.0.1",
    foxglove: Annotated[
        bool, typer.Option("--foxglove", help="serve Foxglove's WebSocket protocol, instead")
    ] = False,
    beside: Annotated[int | None, typer.Option("--beside", hidden=True)] = None,
) -> None:
    """Show what runs on this machine, or a recording, in a browser; it controls nothing."""
    if foxglove:
        with _extra("foxglove"):
            from teleop_rt.view.live.foxglove import bridge_to_foxglove  # noqa: PLC0415
        bridge_to_foxglove(recording, host, port)
        return
    with _extra("live"):
        from teleop_rt.view.live.commands import live as serve  # noqa: PLC0415 - an extra
    serve(recording, beside, host, port)


def live_page_beside(port: int) -> AbstractContextManager[None]:
    """Return the live page of this process's run, served as long as it runs."""
    with _extra("live"):
        from teleop_rt.view.live.commands import live_beside  # noqa: PLC0415 - an extra
    return live_beside(port)


@contextmanager
def _extra(name: str) -> Iterator[None]:
    try:
        yield
    except ImportError:
        message = f"needs an extra: pip install 'teleop-rt[{name}]' adds it"
        raise RecordingError(message) from None
