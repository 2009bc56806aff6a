"""The commands that show a run: its report, and the live page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Annotated

import typer

from teleop_rt.cli.options import LivePort
from teleop_rt.errors import RecordingError


def report(
    folders: Annotated[list[Path], typer.Argument(help="run folder; two or more with --compare")],
    compare: Annotated[
        bool, typer.Option("--compare", help="set runs side by side, on one page")
    ] = False,
    out: Annotated[Path | None, typer.Option("--out", help="the page of a comparison")] = None,
) -> None:
    """Write the report of a run from its folder, also of a run that ended badly."""
    from teleop_rt.cli.reporting import felt_of, rebuilt  # noqa: PLC0415 - loads compilers, drivers

    try:
        from teleop_rt.view.commands import (  # noqa: PLC0415 - an extra may be absent
            compare_folders,
            report_of_folder,
        )
    except ImportError:
        raise RecordingError("no report: pip install 'teleop-rt[report]' adds it") from None
    if (len(folders) > 1) != compare:
        raise RecordingError("give one run folder, or two or more after --compare")
    if compare:
        print(compare_folders(folders, out, rebuilt, felt_of))
    else:
        print(report_of_folder(folders[0], rebuilt, felt_of))


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
