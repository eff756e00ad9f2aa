"""`python -m usvauv_cli`: the same as `usvauv`, for launchers that take a module."""

from usvauv_cli.app import main

if __name__ == "__main__":
    main()
