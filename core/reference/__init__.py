"""What the picture is judged by: equation (1) in float64, photons that walk, and errors against both."""
