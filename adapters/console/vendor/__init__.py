"""The files that the console's pages take from npm, kept so that no user needs Node.

They are those of Open MCT (Apache-2.0), compressed in `static/vendor` with their licences.
"""
