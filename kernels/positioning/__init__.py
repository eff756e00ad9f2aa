"""Underwater acoustic positioning: sonar equation, sound rays, USBL fixes (two models), and a tracker of the AUVs.

From outside use `usbl.Sonar` and `link_table`, `flagged_fixes` and the flags, `waveform.fixes`, `codes`,
`coded_pulse.pulses` and `measurements`, `rays`, `tracker`, `fix_probability`, and `ambient_noise.ambient_noise_laws` to
add a noise law.
"""
