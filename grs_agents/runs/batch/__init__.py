"""Many runs of many scenes: made side by side, told in one table, taken up again where they stopped."""
