"""The links of an agent: LTP, TCPCL and UDPCL, and the contacts they follow."""
