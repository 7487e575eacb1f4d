"""``python -m armdesign`` is the command ``armdesign``."""

from armdesign.cli import main

if __name__ == "__main__":
    main()
