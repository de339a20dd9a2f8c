"""Vendors the files that the console's pages and tests take from npm, so that nobody needs Node.

Pages load files of Open MCT (Apache-2.0), compressed in `static/vendor` with their licences. Tests
use axe-core (MPL-2.0), which is in `tests/console/vendor` and not in the wheel.
"""
