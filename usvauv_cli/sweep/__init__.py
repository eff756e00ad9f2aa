"""Many runs, each done once, on an engine (`engine`): on this machine (`local`), on Ray or under Slurm (`clusters`).

`perform` does runs (`run`) and shows them in the terminal; `results` does those of a study file (`study`) and writes
what they say (`summary`, `report`).
"""
