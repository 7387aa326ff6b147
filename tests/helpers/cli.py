"""These helpers run commands as they are called, and read what they print."""

import errno
import json

from eskin.cli.main import run


def call(capsys, *words):
    """Run a command and return its exit code, its output and its errors."""
    code = run([str(word) for word in words])
    out, err = capsys.readouterr()
    return code, out, err


def call_json(capsys, *words):
    """Run a command that succeeds; return its result as JSON, and what it printed."""
    code, out, err = call(capsys, *words, "--json")
    assert (code, err) == (0, "")
    return json.loads(out.splitlines()[-1]), out


def fail_to_write(*arguments, **options):
    """Fail as the system does where a folder is read-only."""
    raise OSError(errno.EROFS, "Read-only file system")


def assert_refused(capsys, *words, part=""):
    """Check that a command exits with 2 and one line of errors that holds a part.

    Return what it printed besides.
    """
    code, out, err = call(capsys, *words)
    assert code == 2, (words, err)
    assert len(err.splitlines()) == 1, err
    assert part in err, err
    return out
