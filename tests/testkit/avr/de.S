; Sends one character. DE stays off (MODE 0), or goes off in its middle (MODE 1), or a node that
; has DE on does nothing but hold the wire at the mark (MODE 2), or goes on in the start bit (MODE 3).
.include "defs.inc"
.ifndef MODE
.equ MODE, 0
.endif
    sbi DDRD_io, 2
    usart_init 0x08
.if MODE == 1 || MODE == 2
    sbi PORTD_io, 2
.endif
.if MODE != 2
    put UDR0, 0x55
.endif
.if MODE == 3
    ; Half a bit: 52 x 4.
    ldi r24, 52
    ldi r25, 0
4:  sbiw r24, 1
    brne 4b
    sbi PORTD_io, 2
.endif
.if MODE == 1
    ; 4.5 bits of 416 cycles: 468 x 4.
    ldi r24, 468 & 0xff
    ldi r25, 468 >> 8
3:  sbiw r24, 1
    brne 3b
    cbi PORTD_io, 2
.endif
9:  rjmp 9b
