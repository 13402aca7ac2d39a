"""Contact of wheel and rail: profiles, where they touch, contact tables, equivalent conicity."""
