"""The obstacles that motions avoid (zones, rocks, scanned obstacles), and detours around them."""
