"""Many pictures of one scene file: which they are, where they are made, and what is written of them."""
