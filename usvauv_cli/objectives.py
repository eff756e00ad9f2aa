"""Names of what `usvauv plan` maximises and measures."""

MEASUREMENTS = ("fix", "phase")
OBJECTIVES = ("d", "a", "sum", "paper")
NAMES = {"d": "ln det J", "a": "−ln tr J⁻¹", "sum": "ln det ΣJ", "paper": "ln of Eq. 3"}
