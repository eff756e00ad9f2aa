"""Panel beside a view: plots over time and bars of the reward (`plots`), magnified errors (`insets`), a section of the
water (`section`) and the legend (`legend`).
"""
