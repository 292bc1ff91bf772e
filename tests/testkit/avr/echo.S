; Answers each byte with its value plus one, DE (PD2) on from before the byte until it has left.
.include "defs.inc"
    sbi DDRD_io, 2
    usart_init 0x18
1:  lds r17, UCSR0A
    sbrs r17, 7
    rjmp 1b
    lds r18, UDR0
    inc r18
    ; RXC comes in the middle of the stop bit: let it end before driving (400 x 4 cycles).
    ldi r24, 400 & 0xff
    ldi r25, 400 >> 8
3:  sbiw r24, 1
    brne 3b
    sbi PORTD_io, 2
    ldi r17, 0x40
    ori r17, UCSRA
    sts UCSR0A, r17
    sts UDR0, r18
2:  lds r17, UCSR0A
    sbrs r17, 6
    rjmp 2b
    cbi PORTD_io, 2
    rjmp 1b
