"""Run a command of eskin by `python -m eskin`."""

from eskin.cli.main import main

if __name__ == "__main__":
    main()
