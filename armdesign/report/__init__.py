"""What a person reads: tables of words, in the terminal and on one page."""
