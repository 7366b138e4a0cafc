"""`python -m scenegraph`: the command line."""

from __future__ import annotations

from scenegraph.cli import main

if __name__ == "__main__":
    main()
