"""Vendors the files that the console's pages load from npm, so that no user needs Node.

They are files of Open MCT (Apache-2.0), compressed in `static/vendor` with their licences.
"""
