"""Underwater acoustic positioning: sonar equation, sound rays, USBL fixes (two models), and a tracker of the AUVs.

Public: `acoustic_link.Sonar`, `Accuracy` and `link_table`, `usbl.fixes` and the flags, `pulse.pulses`, `codes`
and `tones`, `matched_filter.measurements`, `rays`, `reflections`, `tracker`, and `sonar.absorption_laws` and
`sonar.ambient_noise_laws` to add a law.
"""
