"""The running simulation in a browser tab, drawn there by viser; for `usvauv live`."""
