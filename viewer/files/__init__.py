"""Images, models and photographs, in and out."""
