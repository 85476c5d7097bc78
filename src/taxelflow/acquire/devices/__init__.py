"""Live devices: protocols as pure parsers (bytes in, scans out), and the transports that bytes come by."""
