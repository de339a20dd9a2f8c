"""Links of an agent: LTP, TCPCL and UDPCL, and the contact plan they follow."""
