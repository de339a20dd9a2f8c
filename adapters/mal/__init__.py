"""CCSDS MAL 521.0-B-3 over TCP, as implemented by mo-services-java 12; see the README."""
