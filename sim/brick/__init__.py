"""A USB cable that is not there: rover-nxt and a simulated brick, through pyusb's backend."""
