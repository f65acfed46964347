"""Result files: names and checksums, columns, meaning of the fields, HTML."""
