; Reads EEPROM address 0x23, PB0 up before it and PB1 behind it; then writes 0x5a there and reads again, PB2 up behind that.
; EEDR goes to SRAM from 0x100 both times.
.include "defs.inc"
.equ EECR_io, 0x1f
.equ EEDR_io, 0x20
.equ EEARL_io, 0x21
    ldi r16, 7
    out DDRB_io, r16
    ldi r20, 1
    ldi r21, 3
    ldi r22, 7
    ldi r16, 0x23
    out EEARL_io, r16
    out PORTB_io, r20
    sbi EECR_io, 0
    out PORTB_io, r21
    in r17, EEDR_io
    sts 0x100, r17
    ldi r16, 0x5a
    out EEDR_io, r16
    sbi EECR_io, 2
    sbi EECR_io, 1
    sbi EECR_io, 0
    out PORTB_io, r22
    in r17, EEDR_io
    sts 0x101, r17
9:  rjmp 9b
