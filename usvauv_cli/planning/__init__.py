"""What only `usvauv plan` needs: its figure, and logs of fixes that a real USBL system made."""
