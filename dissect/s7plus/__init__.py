"""S7comm-plus: what frames its PDUs, which function they carry, who asks and who answers; their contents stay octets."""
