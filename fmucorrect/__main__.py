"""`fmucorrect`, and `python -m fmucorrect`, is the command line."""

import sys


def main() -> None:
    """Ctrl-C while the commands are still being imported ends as it does later, without a traceback."""
    try:
        from fmucorrect.cli import main as commands
    except KeyboardInterrupt:
        sys.exit(130)
    commands()


if __name__ == "__main__":
    main()
