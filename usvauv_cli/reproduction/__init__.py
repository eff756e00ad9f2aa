"""The paper's Table 2, Fig. 3 and Fig. 4 made again: settings, runs that go on where they stopped, figures, a page."""
