"""Sound between boats and AUVs in a mission: whose turn it is, what is heard, fixes, and what filters make of them.

`channel` has interrogations and replies, `messages` whether a message is decoded, `replies` the chance of that,
`fixes` what an array measures, `estimates` the boats' estimates of AUVs.
"""
