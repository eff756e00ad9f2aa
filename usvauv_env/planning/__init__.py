"""The best place of the boat for one layout of AUVs, and what to expect of fixes from there.

From outside: `plan.solve` with what it returns, and `fix_errors`.
"""
