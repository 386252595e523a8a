"""Evolution along a leg in load steps."""
