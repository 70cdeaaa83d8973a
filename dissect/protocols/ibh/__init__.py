"""IBH-NetLink: packets of a gateway from Ethernet to MPI, and the S7 PDUs they carry (docs/ibh.md)."""
