"""Run the command line as ``python -m seismo3d``."""

from __future__ import annotations

from seismo3d.cli import main

if __name__ == "__main__":
    main()
