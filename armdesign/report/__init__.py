"""Tables for the reader, in the terminal and on one page."""
