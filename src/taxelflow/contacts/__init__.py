"""Which loaded taxels belong to which contact, whether contacts move apart, and what each is like."""
