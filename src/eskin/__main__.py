"""Run a command of eskin, by `eskin` or `python -m eskin`."""

import gc
import signal


def main() -> None:
    """Run the command in `sys.argv` and exit with its code."""
    # Ctrl-C ends the process without a traceback until the command handles it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    # Modules make many objects that last: to look for garbage among them as often as
    # usual takes a tenth of the time until a command starts.
    gc.set_threshold(20_000, 20, 20)
    from eskin.cli.main import main as run_command

    run_command()


if __name__ == "__main__":
    main()
