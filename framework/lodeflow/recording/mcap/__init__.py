"""The MCAP file format: records, chunks, and what is damaged in them. No lodeflow message here."""
