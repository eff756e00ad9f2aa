"""Underwater acoustic positioning: sonar equation, sound rays, USBL fixes (two models), and a tracker of the AUVs.

Laws for the sonar equation, called from Python: `absorption`, `ambient_noise` and `bubbles`; `sea_wind` has the wind
that noise and bubbles take.

From outside use `usbl.Sonar` and `link_table`, `flagged_fixes` and the flags, `waveform.fixes`, `rays`, `tracker`,
`fix_probability`, and `ambient_noise.ambient_noise_laws` to add a noise law.
"""
