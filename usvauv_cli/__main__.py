"""`python -m usvauv.cli`: the same as `usvauv`, for launchers that take a module."""

from usvauv.cli.app import main

if __name__ == "__main__":
    main()
