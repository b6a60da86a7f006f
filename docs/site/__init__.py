"""What the site needs beside Sphinx: pages of the reference, links of files, equations."""
