"""Display transforms: what becomes of exposed radiance on an sRGB display; one file each."""
