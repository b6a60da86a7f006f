"""What the site needs beside Sphinx: pages written from the code, links to files, equations."""
