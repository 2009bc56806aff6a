"""`export` and `recover` on the command line."""

from contextlib import closing

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap_bytes import contents_of

from teleop_rt.config.section import Units
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.signals import Signal
from teleop_rt_dev.paths import SILICONE

RECOVERED = (
    "2 messages, 1.500 s of the run, saved in cut/recording.recovered.mcap; later messages"
    " are lost\n"
)


def test_recover_and_export_take_the_folder_of_a_run(call, tmp_path):
    (tmp_path / "run").mkdir()
    recording = tmp_path / "run" / "recording.mcap"
    with closing(RecordingWriter(recording, Units(position="m", force="N"))) as writer:
        writer.add_topic("/one", [Signal("stamp_ns", "ns", "when")])
        writer.write_rows("/one", np.array([[1.0], [1.5e9 + 1.0]]))
    code, out, err = call("recover", "run")
    assert (code, err) == (0, "")
    assert out == "run/recording.mcap is whole, with 2 messages: nothing to recover\n"
    assert list((tmp_path / "run").iterdir()) == [recording], "an intact recording gets no copy"
    (tmp_path / "cut").mkdir()
    (tmp_path / "cut" / "recording.mcap").write_bytes(recording.read_bytes()[:-40])
    code, out, err = call("recover", "cut")
    assert (code, out, err) == (0, RECOVERED, "")
    (tmp_path / "piece.mcap").write_bytes(recording.read_bytes()[:30])
    code, out, err = call("recover", "piece.mcap")
    assert (code, out) == (2, "")
    assert err.startswith("piece.mcap: nothing can be recovered: no message can be read in its 30")
    assert not (tmp_path / "piece.recovered.mcap").exists()
    assert call("export", "run", "one.csv", "--topic", "/one")[0] == 0
    code, _, err = call("export", "run", "one.csv", "--topic", "/one")
    assert (code, err) == (2, "one.csv: already exists: name another file, or remove it\n")
    code, _, err = call("export", "run", "none/one.csv", "--topic", "/one")
    assert code == 2
    assert "none/one.csv: cannot be written: No such file or directory" in err


def test_recover_says_what_a_damaged_chunk_cost_and_loses_nothing_behind_it(call, tmp_path):
    path = tmp_path / "run.mcap"
    with closing(RecordingWriter(path, Units(position="m", force="N"))) as writer:
        writer.add_topic("/one", [Signal("stamp_ns", "ns", "when")])
        for start in (0, 1000, 2000):
            writer.write_rows("/one", (start + np.arange(1000.0)[:, None]) * 1e6)
            writer.flush()
    data = path.read_bytes()
    (begin, end) = contents_of(data, Opcode.CHUNK)[1]
    middle = (begin + end) // 2
    path.write_bytes(data[:middle] + bytes(100) + data[middle + 100 :])
    code, out, err = call("recover", "run.mcap")
    lost = "1 part of the file with 1000 messages, of 1.000 s to 1.999 s after its beginning"
    assert code == 0
    assert out == (
        f"2000 messages, 2.999 s of the run, saved in run.recovered.mcap; {lost}, cannot be read;"
        " all others are read\n"
    )
    assert err == (
        f"run.mcap: damaged: {lost}, cannot be read; all others are read; use a copy if there is"
        " one\n"
    )


@pytest.mark.usefixtures("no_pages")
def test_export_and_recover_work_from_the_command_line(call, tmp_path):
    arguments = ("--clock", "simulated", "--duration", 0.5, "--json", "--out", "run")
    assert call("run", SILICONE, *arguments)[0] == 0
    recording = tmp_path / "run" / "recording.mcap"
    code, out, _ = call("export", recording, "t.csv", "--topic", "/master")
    assert (code, out.split()[1]) == (0, "rows")
    (tmp_path / "cut.mcap").write_bytes(recording.read_bytes()[:-5000])
    code, out, _ = call("recover", "cut.mcap")
    assert code == 0
    assert (tmp_path / "cut.recovered.mcap").exists()
    code, _, err = call("export", recording, "u.csv", "--topic", "/nothing")
    assert code == 2
    assert "it has: " in err
