"""The six blocks of the tracker paper, one module each, and what joins them to logs."""
