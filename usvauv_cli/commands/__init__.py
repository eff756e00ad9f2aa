"""One file a command; each is thin: read the options, call the packages below, print."""
