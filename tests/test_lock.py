"""One run at a time, and nothing in the way of the next."""

import errno
import os
import signal

import pytest

from diffprt.cli import main
from diffprt.errors import InputError
from diffprt.lock import lock_file, locked


def test_a_lock_dies_with_its_process(tmp_path):
    """Hard case 45: the second run is refused by name and number; after a kill the next one goes on."""
    output = tmp_path / "asset.prt"
    ready, write = os.pipe()
    process = os.fork()
    if process == 0:
        with locked(output, lock_file(output)):
            os.write(write, b"1")
            signal.pause()
    try:
        assert os.read(ready, 1) == b"1"
        refusal = rf"asset\.prt is being written by another run \(process {process}\): wait"
        with pytest.raises(InputError, match=refusal), locked(output, lock_file(output)):
            pass
    finally:
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
    assert lock_file(output).read_text() == f"diffprt {process}\n"
    with locked(output, lock_file(output)) as alone:
        assert alone and lock_file(output).read_text() == f"diffprt {os.getpid()}\n"
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_lock_file_is_left_as_it_is(tmp_path):
    file = lock_file(tmp_path / "asset.prt")
    file.write_text("mine")
    with locked(tmp_path / "asset.prt", file) as alone:
        assert alone
        with pytest.raises(InputError, match="another run: wait"), locked(tmp_path / "asset.prt", file):
            pass
    assert file.read_text() == "mine"


@pytest.mark.parametrize("harm", ["no locks", "a folder", "a link", "no folder"])
def test_without_locks_it_says_so_and_goes_on(harm, tmp_path, monkeypatch):
    file, said = lock_file(tmp_path / "asset.prt"), []
    if harm == "no locks":

        def refuse(*_):
            raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

        monkeypatch.setattr("fcntl.flock", refuse)
    elif harm == "a folder":
        file.mkdir()
    elif harm == "a link":
        file.symlink_to("elsewhere")
    else:
        file = tmp_path / "none" / "lock"
    with locked(tmp_path / "asset.prt", file, said.append) as alone:
        assert not alone
    assert len(said) == 1 and "asset.prt cannot be locked (" in said[0]
    assert harm != "no locks" or list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["compress", "render", "export"])
def test_every_command_holds_its_output(command, tmp_path, bumpy_transfer, capsys):
    from diffprt.representation.files import save

    save(bumpy_transfer, tmp_path / "in.prt")
    output = tmp_path / {"compress": "out.prt", "render": "out.png", "export": "out"}[command]
    file = lock_file(output)
    if command == "export":
        output.mkdir()
        file = output / ".diffprt.lock"
    arguments = [command, str(tmp_path / "in.prt"), "-o", str(output)]
    with locked(output, file), pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert f"{output} is being written by another run (process {os.getpid()})" in said and said.count("\n") == 1
    assert not output.is_file() and not list(output.glob("*"))
