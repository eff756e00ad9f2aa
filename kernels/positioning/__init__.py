"""Underwater acoustic positioning: sonar equation, sound rays, USBL fixes (two models), and a tracker of the AUVs.

Laws for the sonar equation, called from Python: `absorption`, `ambient_noise` and `bubbles`; `sea_wind` has the wind
that noise and bubbles take.

From outside use `acoustic_link.Sonar`, `Accuracy` and `link_table`, `usbl.flagged_fixes` and the flags,
`pulse.pulses`, `codes`, `tones` and `measurements`, `rays`, `tracker`, `fix_probability`, and
`ambient_noise.ambient_noise_laws` to add a noise law.
"""
