; Sends 0x55 0x0f 0xa5 the moment UDRE allows it, DE on throughout; PB0 high once TXC stands.
; GAP: cycles (times 4) waited before the third character.
.include "defs.inc"
.ifndef GAP
.equ GAP, 0
.endif
    sbi DDRD_io, 2
    sbi DDRB_io, 0
    sbi PORTD_io, 2
    usart_init 0x08
    put UDR0, 0x55
1:  lds r17, UCSR0A
    sbrs r17, 5
    rjmp 1b
    put UDR0, 0x0f
2:  lds r17, UCSR0A
    sbrs r17, 5
    rjmp 2b
.if GAP
    ldi r24, GAP & 0xff
    ldi r25, GAP >> 8
4:  sbiw r24, 1
    brne 4b
.endif
    put UDR0, 0xa5
3:  lds r17, UCSR0A
    sbrs r17, 6
    rjmp 3b
    sbi PORTB_io, 0
5:  rjmp 5b
