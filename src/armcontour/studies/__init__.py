"""Studies: what plans one job many times. Certificates, and places of a part or a base."""
