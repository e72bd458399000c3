"""An interactive view in a notebook, with orbit and sliders."""
