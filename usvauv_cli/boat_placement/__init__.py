"""Modules for `usvauv plan` alone: its figure, and logs of fixes from a real USBL system."""
