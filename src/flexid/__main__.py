"""Run the command line by ``python -m flexid``."""

from flexid.cli.main import main

if __name__ == "__main__":
    main()
