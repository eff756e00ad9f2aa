"""Underwater acoustic positioning: sonar equation, sound rays, USBL fixes, and a tracker of the AUVs.

Public: `acoustic_link.Sonar`, `Accuracy` and `link_table`, `usbl.fixes` and the flags, `rays`, `tracker`, and
`laws.absorption_laws` and `laws.ambient_noise_laws` to add a law.
"""
