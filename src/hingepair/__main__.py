"""The program `hingepair`, and `python -m hingepair`: the command line."""

import signal
import sys


def main() -> None:
    """Run the command line; Ctrl-C ends it without a traceback, while its modules are still being imported too."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, lambda *_: sys.exit(130))
    from hingepair.cli.main import main as run

    run()


if __name__ == "__main__":
    main()
