"""The program `hingepair`, and `python -m hingepair`: the command line."""

from hingepair.cli.main import main

if __name__ == "__main__":
    main()
