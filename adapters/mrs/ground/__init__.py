"""The client of the MRS: commands a rover and hears what it reports."""
