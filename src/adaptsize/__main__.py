"""``python -m adaptsize``: the same as the command ``adaptsize``."""

from adaptsize.cli import main

if __name__ == "__main__":
    main()
