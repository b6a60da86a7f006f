"""Studies that plan a job many times: certificates, and placements of a part or a base."""
