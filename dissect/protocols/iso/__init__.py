"""TPKT frames, COTP TPDUs and the TSDUs they carry."""
