"""Run a command of eskin, by `eskin` or `python -m eskin`."""

import signal


def main() -> None:
    """Run the command in `sys.argv` and exit with its code."""
    # Ctrl-C ends the process without a traceback until the command handles it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from eskin.cli.main import main as run_command

    run_command()


if __name__ == "__main__":
    main()
