"""What both ends of the MRS share: specification, types, errors, and core values on the wire."""
