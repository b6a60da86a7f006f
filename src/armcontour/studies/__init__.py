"""Studies that plan one job many times: certificates, and placements of a part or a base."""
