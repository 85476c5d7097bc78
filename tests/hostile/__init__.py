"""Files made to harm: what each costs until it is refused, and a fuzzer that changes whole files in their structure."""
