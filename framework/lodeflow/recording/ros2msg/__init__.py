"""Messages by the definition that stands in their file, whatever members it has."""
