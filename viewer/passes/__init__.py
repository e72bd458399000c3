"""One GPU pass a file, with its record and uniforms."""
