"""How far a picture is from the truth, as numbers and as a map."""
