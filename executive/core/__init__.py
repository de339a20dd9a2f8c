"""The core's loop: receives commands, gives goals to the tree, sends reports. See `runner`."""
